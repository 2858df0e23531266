{{ ABOUT }}#include "SHIP.h"

#include <float.h>
#include <math.h>
#include <stddef.h>
#include <string.h>

#define real SHIP_real
{{ PRELUDE }}
{{ TABLES }}{{ NETWORK }}
void SHIP_init(SHIP_model *model, const real *coefficients) {
  int i;
  for (i = 0; i < {{ P }}; i++)
    model->coefficients[i] = coefficients ? coefficients[i] : (real)SHIP_coefficient_defaults[i];
  {
{% for line in INIT %}
  {{ line }}
{% endfor %}
  }
}

static void input_stage(const SHIP_model *model, const real *inputs, real *held) {
{% for line in INPUT_STAGE %}
  {{ line }}
{% endfor %}
  (void)model;
  (void)inputs;
  (void)held;
}

static void state_stage(const SHIP_model *model, const real *held, const real *state, const real *inputs, real *rates) {
{% if NETWORK %}
  real features[{{ F }}];
{% endif %}
{% for line in STATE_STAGE %}
  {{ line }}
{% endfor %}
{% if NETWORK %}
  network_add(features, rates);
{% endif %}
  (void)model;
  (void)held;
  (void)state;
  (void)inputs;
}

void SHIP_rates(const SHIP_model *model, const real *state, const real *inputs, real *rates) {
  real held[{{ HELD }}];
  input_stage(model, inputs, held);
  state_stage(model, held, state, inputs, rates);
}

void SHIP_forces(const SHIP_model *model, const real *state, const real *inputs, real *forces) {
{% for line in FORCES %}
  {{ line }}
{% endfor %}
  (void)model;
  (void)state;
  (void)inputs;
}

void SHIP_columns(const SHIP_model *model, const real *state, real *columns) {
{% for line in COLUMNS %}
  {{ line }}
{% endfor %}
  (void)model;
}

void SHIP_columns_jacobian(const SHIP_model *model, const real *state, real *by_state) {
{% for line in COLUMNS_Z %}
  {{ line }}
{% endfor %}
  (void)model;
  (void)state;
}

static void settle(const SHIP_model *model, const real *state, const real *inputs, real *settled) {
{% for line in SETTLED %}
  {{ line }}
{% endfor %}
  (void)model;
  (void)state;
  (void)inputs;
}

void SHIP_settle(const SHIP_model *model, const real *columns, const real *inputs, real *state) {
{% if MEASURED %}
  real six[6], logged[6];
  int i; int k;
{% else %}
  real six[6];
  int i;
{% endif %}
  for (i = 0; i < 6; i++) six[i] = columns[i];
  settle(model, six, inputs, state);
{% if MEASURED %}
  for (k = 0; k < {{ INVERSIONS }}; k++) {
    real most = R(0.0);
    SHIP_columns(model, state, logged);
    for (i = 0; i < 6; i++) {
      const real error = logged[i] - columns[i];
      most = error > most ? error : (-error > most ? -error : most);
      six[i] -= error;
    }
    settle(model, six, inputs, state);
    if (!(most > R(1e-12))) break;
  }
{% endif %}
}

void SHIP_jacobians(const SHIP_model *model, const real *state, const real *inputs,
  real *by_state, real *by_inputs) {
{% if NETWORK %}
  real features[{{ F }}], by[{{ 3 * PLACES | length }}], feature_z[{{ F * S }}], feature_c[{{ F * C }}];
  static const int at[{{ PLACES | length }}] = { {{- PLACES | join(", ") -}} };
  int i, j, k;
{% endif %}
{% for line in JACOBIANS %}
  {{ line }}
{% endfor %}
{% if NETWORK %}
  network_jacobian(features, by);
{% for target, source, width in (("by_state", "feature_z", S), ("by_inputs", "feature_c", C)) %}
  for (i = 0; i < 3; i++) for (k = 0; k < {{ PLACES | length }}; k++) for (j = 0; j < {{ width }}; j++)
    {{ target }}[(3 + i) * {{ width }} + j] += by[i * {{ PLACES | length }} + k] * {{ source }}[at[k] * {{ width }} + j];
{% endfor %}
{% endif %}
  (void)model;
  (void)state;
  (void)inputs;
}

/* whether the last byte of a number comes first in memory */
static int bytes_reversed(void) {
  const double one = 1.0;
  unsigned char bytes[sizeof(double)];
  memcpy(bytes, &one, sizeof one);
  return bytes[0] != 0;
}

/* whether numbers are finite, also under -ffast-math: by the bits of their exponents */
static int finite_numbers(const real *numbers, int count) {
  int i, good = 1;
  for (i = 0; i < count; i++) {
    const double x = (double)numbers[i];
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
  real held[{{ HELD }}], z[{{ S }}], at[{{ S }}], k[{{ S }}], sum[{{ S }}];
  const real step = (real)(h / steps), half = R(0.5) * step;
  int i, n;
  input_stage(model, inputs, held);
  for (i = 0; i < {{ S }}; i++) z[i] = state[i];
  for (n = 0; n < steps; n++) {
    state_stage(model, held, z, inputs, k);
    for (i = 0; i < {{ S }}; i++) { sum[i] = k[i]; at[i] = z[i] + half * k[i]; }
    state_stage(model, held, at, inputs, k);
    for (i = 0; i < {{ S }}; i++) { sum[i] += R(2.0) * k[i]; at[i] = z[i] + half * k[i]; }
    state_stage(model, held, at, inputs, k);
    for (i = 0; i < {{ S }}; i++) { sum[i] += R(2.0) * k[i]; at[i] = z[i] + step * k[i]; }
    state_stage(model, held, at, inputs, k);
    for (i = 0; i < {{ S }}; i++) z[i] += step / R(6.0) * (sum[i] + k[i]);
  }
  if (!finite_numbers(z, {{ S }})) return 1;
  for (i = 0; i < {{ S }}; i++) state[i] = z[i];
  return 0;
}

int SHIP_step(const SHIP_model *model, real *state, const real *inputs, double h) {
  const int steps = steps_of(h);
  return steps < 0 ? 1 : (steps == 0 ? 0 : advance(model, state, inputs, h, steps));
}
{% if LANES %}
{{ LANE_FUNCTIONS }}static int lanes_input(const SHIP_model *model, real inputs[][{{ LANES }}], real held[][{{ LANES }}]) {
  real a0[{{ LANES }}], a1[{{ LANES }}];
  int l, odd = 0;
{% for line in LANES_INPUT %}
  {{ line }}
{% endfor %}
  (void)model; (void)held; (void)inputs; (void)a0; (void)a1; (void)l;
  return odd;
}

{{ LANES_NETWORK }}static int lanes_rates(const SHIP_model *model, real held[][{{ LANES }}], real state[][{{ LANES }}],
  real inputs[][{{ LANES }}], real rates[][{{ LANES }}]) {
{% if NETWORK %}
  real x[{{ PLACES | length }}][{{ LANES }}];
{% endif %}
  real a0[{{ LANES }}], a1[{{ LANES }}];
  int l, odd = 0;
{% for line in LANES_RATES %}
  {{ line }}
{% endfor %}
{% if NETWORK %}
  lanes_network(x, rates);
{% endif %}
  (void)model; (void)held; (void)inputs; (void)a0; (void)a1; (void)state;
  return odd;
}

/* {{ LANES }} ships at once; 1 where one of them cannot be served so */
static int lanes_advance(const SHIP_model *model, real *states, const real *inputs, double h, int steps) {
  real held[{{ HELD }}][{{ LANES }}], c[{{ C }}][{{ LANES }}], z[{{ S }}][{{ LANES }}], at[{{ S }}][{{ LANES }}], k[{{ S }}][{{ LANES }}];
  real sum[{{ S }}][{{ LANES }}], one[{{ S }}];
  const real step = (real)(h / steps), half = R(0.5) * step;
  int i, l, n, s, odd = 0;
  for (l = 0; l < {{ LANES }}; l++) {
    for (i = 0; i < {{ S }}; i++) z[i][l] = states[l * {{ S }} + i];
    for (i = 0; i < {{ C }}; i++) c[i][l] = inputs[l * {{ C }} + i];
  }
  odd |= lanes_input(model, c, held);
  for (n = 0; n < steps && !odd; n++) {
    for (s = 0; s < 4; s++) {
      const real weight = s == 0 || s == 3 ? R(1.0) : R(2.0), next = s == 2 ? step : half;
      odd |= lanes_rates(model, held, s ? at : z, c, k);
      for (i = 0; i < {{ S }}; i++)
        for (l = 0; l < {{ LANES }}; l++) {
          sum[i][l] = s ? sum[i][l] + weight * k[i][l] : k[i][l];
          at[i][l] = z[i][l] + next * k[i][l];
        }
    }
    for (i = 0; i < {{ S }}; i++)
      for (l = 0; l < {{ LANES }}; l++) z[i][l] += step / R(6.0) * sum[i][l];
  }
  for (l = 0; l < {{ LANES }} && !odd; l++) {
    for (i = 0; i < {{ S }}; i++) one[i] = z[i][l];
    odd |= !finite_numbers(one, {{ S }});
  }
  if (odd) return 1;
  for (l = 0; l < {{ LANES }}; l++)
    for (i = 0; i < {{ S }}; i++) states[l * {{ S }} + i] = z[i][l];
  return 0;
}

int SHIP_step_many(const SHIP_model *model, int count, real *states, const real *inputs, double h) {
  const int steps = steps_of(h);
  int i, j, failed = 0;
  if (steps < 0) return count > 0 ? count : 0;
  if (steps == 0) return 0;
  for (i = 0; i < count; i += {{ LANES }}) {
    const int several = count - i < {{ LANES }} ? count - i : {{ LANES }};
    real *z = states + (size_t)i * {{ S }};
    const real *c = inputs + (size_t)i * {{ C }};
    if (several == {{ LANES }} && !lanes_advance(model, z, c, h, steps)) continue;
    for (j = 0; j < several; j++) failed += advance(model, z + (size_t)j * {{ S }}, c + (size_t)j * {{ C }}, h, steps);
  }
  return failed;
}
{% else %}

int SHIP_step_many(const SHIP_model *model, int count, real *states, const real *inputs, double h) {
  int i, failed = 0;
  for (i = 0; i < count; i++) failed += SHIP_step(model, states + (size_t)i * {{ S }}, inputs + (size_t)i * {{ C }}, h);
  return failed;
}
{% endif %}

double SHIP_extrapolation(const SHIP_model *model, const real *state, const real *inputs) {
{% if RANGES %}
  (void)model; (void)inputs;
  if (!finite_numbers(state, {{ S }})) return DBL_MAX;
{% for line in RANGE_STATEMENTS %}
  {{ line }}
{% endfor %}
  double x[{{ RANGES | length }}], most = 0.0;
  int i;
{% for name, (low, high) in RANGES.items() %}
{% if name in FEATURE %}
  x[{{ loop.index0 }}] = (double)({{ FEATURE[name] }});
{% else %}
  x[{{ loop.index0 }}] = {{ 0.5 * (low + high) }};
  if ((double)({{ FEATURE.u }} * {{ FEATURE.u }} + {{ FEATURE.v }} * {{ FEATURE.v }}) > {{ SLOW }})
    x[{{ loop.index0 }}] = atan2((double)(-({{ FEATURE.v }})), (double)({{ FEATURE.u }}));
{% endif %}
{% endfor %}
  for (i = 0; i < {{ RANGES | length }}; i++) {
    const double low = SHIP_range_lower[i], high = SHIP_range_upper[i];
    const double size = 0.1 * (fabs(low) > fabs(high) ? fabs(low) : fabs(high));
    const double width = high - low > size ? high - low : size;
    const double beyond = x[i] > high ? x[i] - high : (x[i] < low ? low - x[i] : 0.0);
    const double share = beyond > 0.0 ? beyond / (width > 1e-12 ? width : 1e-12) : 0.0;
    if (share > most) most = share;
  }
  return most;
{% else %}
  (void)model; (void)state; (void)inputs;
  return -1.0;
{% endif %}
}
{{ MORE }}{% for name in UNDONE %}
#undef {{ name }}
{% endfor %}
