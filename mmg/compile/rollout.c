/* The integration loop of a vector of points; c: inputs held over a step; H: what they give. A vector that would end beyond the points is moved back: those it repeats come out the same. */
typedef struct {
  long long points, steps, euler;
  const double *start, *controls, *dt, *theta;
  const unsigned char* keep;
  double* out;
  long long c_step, c_row, c_point, dt_step, dt_point, theta_row, theta_point;
} Run;
#define AT(p, each) ((each) ? load((p) + i) : fill(*(p)))
#define EACH(j, size) for (int j = 0; j < size; j++)
static void shared(const V* p, V* K) {
  @shared@
}
static void inputs(const V* c, const V* p, const V* K, V* H) {
  @inputs@
}
static void rates(const V* q, const V* c, const V* p, const V* K, const V* H, V* d) {
  @rates@
}
static void read_controls(const Run* r, long long step, long long i, V* c) {
  EACH(j, @C@) c[j] = AT(r->controls + step * r->c_step + j * r->c_row, r->c_point);
}
EXPORT void rollout(const Run* r) {
  V p[@P@ + 1], K[@K@ + 1], H[@H@ + 1], c[@C@ + 1], h;
  V z[@S@], y[@S@], k1[@S@], k2[@S@], k3[@S@], k4[@S@];
  for (long long at = 0; at < r->points; at += LANES) {
    const long long i = at + LANES <= r->points ? at : r->points - LANES;
    double* out = r->out;
    EACH(j, @P@) p[j] = AT(r->theta + j * r->theta_row, r->theta_point);
    shared(p, K);
    EACH(s, @S@) { z[s] = load(r->start + s * r->points + i); store(out + s * r->points + i, z[s]); }
    out += @S@ * r->points;
    for (long long step = 0; step < r->steps; step++) {
      h = AT(r->dt + step * r->dt_step, r->dt_point);
      read_controls(r, step, i, c);
      inputs(c, p, K, H);
      rates(z + @first@, c, p, K, H, k1);
      if (r->euler) {
        EACH(s, @S@) z[s] = z[s] + h * k1[s];
      } else {
        @stages@
      }
      if (!r->keep[step]) continue;
      EACH(s, @S@) store(out + s * r->points + i, z[s]);
      out += @S@ * r->points;
    }
  }
}
