
/* @LANES@ ships at once; 1 where one of them cannot be served so */
static int lanes_advance(const SHIP_model *model, real *states, const real *inputs, double h, int steps) {
  real held[@HELD@][@LANES@], c[@C@][@LANES@], z[@S@][@LANES@], at[@S@][@LANES@], k[@S@][@LANES@];
  real sum[@S@][@LANES@], one[@S@];
  const real step = (real)(h / steps), half = R(0.5) * step;
  int i, l, n, s, odd = 0;
  for (l = 0; l < @LANES@; l++) {
    for (i = 0; i < @S@; i++) z[i][l] = states[l * @S@ + i];
    for (i = 0; i < @C@; i++) c[i][l] = inputs[l * @C@ + i];
  }
  odd |= lanes_input(model, c, held);
  for (n = 0; n < steps && !odd; n++) {
    for (s = 0; s < 4; s++) {
      const real weight = s == 0 || s == 3 ? R(1.0) : R(2.0), next = s == 2 ? step : half;
      odd |= lanes_rates(model, held, s ? at : z, c, k);
      for (i = 0; i < @S@; i++)
        for (l = 0; l < @LANES@; l++) {
          sum[i][l] = s ? sum[i][l] + weight * k[i][l] : k[i][l];
          at[i][l] = z[i][l] + next * k[i][l];
        }
    }
    for (i = 0; i < @S@; i++)
      for (l = 0; l < @LANES@; l++) z[i][l] += step / R(6.0) * sum[i][l];
  }
  for (l = 0; l < @LANES@ && !odd; l++) {
    for (i = 0; i < @S@; i++) one[i] = z[i][l];
    odd |= !finite_state(one);
  }
  if (odd) return 1;
  for (l = 0; l < @LANES@; l++)
    for (i = 0; i < @S@; i++) states[l * @S@ + i] = z[i][l];
  return 0;
}

int SHIP_step_many(const SHIP_model *model, int count, real *states, const real *inputs, double h) {
  const int steps = steps_of(h);
  int i, j, failed = 0;
  if (steps < 0) return count > 0 ? count : 0;
  if (steps == 0) return 0;
  for (i = 0; i < count; i += @LANES@) {
    const int several = count - i < @LANES@ ? count - i : @LANES@;
    real *z = states + (size_t)i * @S@;
    const real *c = inputs + (size_t)i * @C@;
    if (several == @LANES@ && !lanes_advance(model, z, c, h, steps)) continue;
    for (j = 0; j < several; j++) failed += advance(model, z + (size_t)j * @S@, c + (size_t)j * @C@, h, steps);
  }
  return failed;
}
