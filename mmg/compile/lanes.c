/* whether an argument is beyond what the functions below serve */
static int lanes_odd(const real *x, real most) {
  int l, odd = 0;
  for (l = 0; l < @lanes@; l++) odd |= !(x[l] < most && x[l] > -most);
  return odd;
}

/* sin(x + quarter pi / 2): x less a whole number of quarter turns, a series each for sine and cosine */
static int lanes_wave(const real *x, int quarter, real *y) {
  int l;
  if (lanes_odd(x, R(1e5))) return 1;
  for (l = 0; l < @lanes@; l++) {
    const int turns = (int)(x[l] * R(0.6366197723675814) + R(1048576.5)) - 1048576;
    const real n = (real)turns;
    const real r = ((x[l] - n * R(1.5707963267341256)) - n * R(6.077100506303966e-11)) - n * R(2.0222662487959506e-21);
    const real z = r * r;
    const real s = r + r * z * @sine@;
    const real c = R(1.0) - R(0.5) * z + z * z * @cosine@;
    const real odd = (real)((turns + quarter) & 1), side = (real)(1 - ((turns + quarter) & 2));
    y[l] = side * (s + odd * (c - s));
  }
  return 0;
}

static int lanes_sin(const real *x, real *y) { return lanes_wave(x, 0, y); }

static int lanes_cos(const real *x, real *y) { return lanes_wave(x, 1, y); }

static int lanes_tanh(real *x, real *y) {
  int l, odd = 0;
  for (l = 0; l < @lanes@; l++) {
    odd |= !(x[l] < R(1e30) && x[l] > R(-1e30));
    if (x[l] > R(20.0)) x[l] = R(20.0);
    if (x[l] < R(-20.0)) x[l] = R(-20.0);
  }
  for (l = 0; l < @lanes@; l++) {
    @tanh@
    y[l] = p / (p + R(2.0));
  }
  return odd;
}

static int lanes_atan2(const real *y, const real *x, real *angle) {
  int l;
  if (lanes_odd(x, R(1e30)) | lanes_odd(y, R(1e30))) return 1;
  for (l = 0; l < @lanes@; l++) {
    const real a = m_fabs(x[l]), b = m_fabs(y[l]);
    const real larger = b > a ? b : a, smaller = b > a ? a : b;
    const real steep = b > a ? R(1.0) : R(0.0), wide = smaller > R(0.41421356237309503) * larger ? R(1.0) : R(0.0);
    const real over = smaller - wide * larger, under = larger + wide * smaller + R(1e-30);
    const real t = over / under, z = t * t;
    const real e = wide * R(0.7853981633974483) + (t + t * z * @arc@);
    const real first = steep * R(1.5707963267948966) + (R(1.0) - R(2.0) * steep) * e;
    const real behind = x[l] < R(0.0) ? R(1.0) : R(0.0);
    const real all = behind * R(3.141592653589793) + (R(1.0) - R(2.0) * behind) * first;
    angle[l] = y[l] < R(0.0) ? -all : all;
  }
  return 0;
}
