
/* whether a state is finite, also under -ffast-math: by the bits of its exponents */
/* whether the last byte of a number comes first in memory */
static int bytes_reversed(void) {
  const double one = 1.0;
  unsigned char bytes[sizeof(double)];
  memcpy(bytes, &one, sizeof one);
  return bytes[0] != 0;
}

static int finite_state(const real *state) {
  int i, good = 1;
  for (i = 0; i < @S@; i++) {
    const double x = (double)state[i];
    unsigned char bytes[sizeof(double)];
    unsigned high, low;
    memcpy(bytes, &x, sizeof x);
    high = bytes[sizeof(double) - 1];
    low = bytes[sizeof(double) - 2];
    if (bytes_reversed()) {
      high = bytes[0];
      low = bytes[1];
    }
    good &= !((high & 0x7fu) == 0x7fu && (low & 0xf0u) == 0xf0u);
  }
  return good;
}

static int steps_of(double h) {
  if (!(h >= 0.0) || h > 1e6 * UPPER_LONGEST_STEP) return -1;
  if (h <= 0.0) return 0;
  return h <= UPPER_LONGEST_STEP ? 1 : (int)ceil(h / UPPER_LONGEST_STEP - 1e-9);
}

static int advance(const SHIP_model *model, real *state, const real *inputs, double h, int steps) {
  real held[@HELD@], z[@S@], at[@S@], k[@S@], sum[@S@];
  const real step = (real)(h / steps), half = R(0.5) * step;
  int i, n;
  input_stage(model, inputs, held);
  for (i = 0; i < @S@; i++) z[i] = state[i];
  for (n = 0; n < steps; n++) {
    state_stage(model, held, z, inputs, k);
    for (i = 0; i < @S@; i++) { sum[i] = k[i]; at[i] = z[i] + half * k[i]; }
    state_stage(model, held, at, inputs, k);
    for (i = 0; i < @S@; i++) { sum[i] += R(2.0) * k[i]; at[i] = z[i] + half * k[i]; }
    state_stage(model, held, at, inputs, k);
    for (i = 0; i < @S@; i++) { sum[i] += R(2.0) * k[i]; at[i] = z[i] + step * k[i]; }
    state_stage(model, held, at, inputs, k);
    for (i = 0; i < @S@; i++) z[i] += step / R(6.0) * (sum[i] + k[i]);
  }
  if (!finite_state(z)) return 1;
  for (i = 0; i < @S@; i++) state[i] = z[i];
  return 0;
}

int SHIP_step(const SHIP_model *model, real *state, const real *inputs, double h) {
  const int steps = steps_of(h);
  return steps < 0 ? 1 : (steps == 0 ? 0 : advance(model, state, inputs, h, steps));
}
