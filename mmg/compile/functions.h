#define MATH static V
#define quotient(a, b) ((a) / (b))
#define compare(m) choose(m, fill(1.0), fill(0.0))
#define when(c, x) choose((c) != 0.0, x, fill(0.0))
#define MAGNITUDE 0x7fffffffffffffffULL
/* 1.5 x 2^52: added to a number below 2^51 it leaves the nearest whole number in the low bits of the sum. */
#define ROUND 6755399441055744.0
INLINE V absolute(V x) { return real(bits(x) & MAGNITUDE); }
INLINE V signed_as(V x, V y) { return real((bits(x) & MAGNITUDE) | (bits(y) & ~MAGNITUDE)); }
INLINE V power_of_2(V shifted) { return real((bits(shifted) + 1023) << 52); }
/* x - n ln 2, ln 2 in two parts of which the first has so few digits that n times it is exact. */
INLINE V beyond_ln2(V x, V n) { return (x - n * 0x1.62e42feep-1) - n * 0x1.a39ef35793c76p-33; }
INLINE V expm1_small(V z) { return more(z * z, @expm1@, z); }
MATH v_exp(V x) {
  const V y = choose(x > 710.0, fill(710.0), choose(x < -708.0, fill(-708.0), x));
  const V shifted = y * @per_ln2@ + ROUND, n = shifted - ROUND;
  /* half of the power, then twice: 2^1024 by itself has no exponent */
  const V e = (1.0 + expm1_small(beyond_ln2(y, n))) * power_of_2(shifted - 1.0) * 2.0;
  return choose(x < -708.0, fill(0.0), e);
}
/* e / (e + 2) with e = exp(2 |x|) - 1, which loses no digits at small x; beyond |x| = 22 it is 1 to the last bit. */
MATH v_tanh(V x) {
  const V a = 2.0 * absolute(x), y = choose(a > 44.0, fill(44.0), a);
  const V shifted = y * @per_ln2@ + ROUND, n = shifted - ROUND, p = power_of_2(shifted);
  const V e = more(p, expm1_small(beyond_ln2(y, n)), p - 1.0);
  return signed_as(quotient(e, e + 2.0), x);
}
/* sin(x + quarter pi / 2): x less k quarter turns, in three parts of pi / 2; odd k take the cosine, k & 2 the sign. */
INLINE V wave(V x, unsigned long long quarter) {
  const V shifted = x * @per_quarter@ + ROUND, n = shifted - ROUND;
  const V r = ((x - n * 0x1.921fb544p+0) - n * 0x1.0b4611a6p-34) - n * 0x1.3198a2e037073p-69;
  const V z = r * r;
  const U k = bits(shifted) + quarter;
  const V s = more(r * z, @sin@, r);
  const V c = more(z * z, @cos@, 1.0 - 0.5 * z);
  const V even = choose((k & 1) == 0, s, c);
  return real(bits(even) ^ ((k & 2) << 62));
}
MATH v_sin(V x) {
  const V y = wave(x, 0);
  const M large = absolute(x) > 1e5;
  return any(large) ? choose(large, each_sin(x), y) : y;
}
MATH v_cos(V x) {
  const V y = wave(x, 1);
  const M large = absolute(x) > 1e5;
  return any(large) ? choose(large, each_cos(x), y) : y;
}
/* Of the acute angle to the nearer axis, and of what that exceeds pi / 8 by turning the vector back by pi / 4. */
MATH v_atan2(V y, V x) {
  const V a = absolute(x), b = absolute(y);
  const M steep = b > a;
  const V larger = choose(steep, b, a), smaller = choose(steep, a, b);
  const M wide = smaller > 0.41421356237309503 * larger;
  const V over = choose(wide, smaller - larger, smaller), under = choose(wide, smaller + larger, larger);
  const V t = over / choose(under == 0.0, fill(1.0), under), z = t * t;
  const V arc = more(t * z, @arc@, t);
  const V e = choose(wide, 0x1.921fb54442d18p-1 + (0x1.1a62633145c07p-55 + arc), arc);
  const V first = choose(steep, 0x1.921fb54442d18p+0 - (e - 0x1.1a62633145c07p-54), e);
  const V all = choose((bits(x) >> 63) != 0, 0x1.921fb54442d18p+1 - (first - 0x1.1a62633145c07p-53), first);
  const V angle = signed_as(all, y);
  const M large = smaller > 1e300;
  return any(large) ? choose(large, each_atan2(y, x), angle) : angle;
}
