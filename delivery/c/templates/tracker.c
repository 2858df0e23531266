
/* ---- The filter ------------------------------------------------------------------------------------------------- */
#ifdef UPPER_SINGLE
#error "the filter needs double precision"
#endif
{% for name, (count, numbers) in CONSTANTS.items() if count %}
static const real filter_{{ name }}[{{ count }}] = {
  {{ numbers }}};
{% endfor %}

void SHIP_start(SHIP_filter *f, const real *coefficients) {
  memset(f, 0, sizeof *f);
  SHIP_init(&f->model, coefficients);
  memcpy(f->noise.sizes, filter_sizes, sizeof filter_sizes);
  memcpy(f->noise.memories, filter_memories, sizeof filter_memories);
  memcpy(f->noise.sensors, filter_sensors, sizeof filter_sensors);
  f->noise.interval = {{ INTERVAL }};
}

/* The state z h seconds later, random ones held, and derivatives A of the ship's states then by z, row by row. */
static void linearised_step(const SHIP_model *model, const real *inputs, real h, real *z, real *A) {
  static const real node[4] = {0.0, 0.5, 0.5, 1.0}, weight[4] = {1.0 / 6, 1.0 / 3, 1.0 / 3, 1.0 / 6};
  real at[{{ S }}], rate[{{ S }}] = {0}, total[{{ X }}] = {0}, by_state[{{ S * S }}], by_inputs[{{ S * C }}];
  real Z[{{ S * S }}] = {0}, slope[{{ X * S }}] = {0}, sum[{{ X * S }}] = {0};
  int i, j, k, stage;
  for (i = 0; i < {{ S }}; i++) Z[i * {{ S + 1 }}] = 1.0;
  memcpy(at, z, sizeof at);
  for (stage = 0; stage < 4; stage++) {
    const real part = node[stage] * h;
    for (i = 0; i < {{ X }}; i++) {
      at[i] = z[i] + part * rate[i];
      for (j = 0; j < {{ S }}; j++) Z[i * {{ S }} + j] = (real)(i == j) + part * slope[i * {{ S }} + j];
    }
    SHIP_rates(model, at, inputs, rate);
    SHIP_jacobians(model, at, inputs, by_state, by_inputs);
    for (i = 0; i < {{ X }}; i++) {
      total[i] += weight[stage] * rate[i];
      for (j = 0; j < {{ S }}; j++) {
        real changed = 0.0;
        for (k = 0; k < {{ S }}; k++) changed += by_state[i * {{ S }} + k] * Z[k * {{ S }} + j];
        slope[i * {{ S }} + j] = changed;
        sum[i * {{ S }} + j] += weight[stage] * changed;
      }
    }
  }
  for (i = 0; i < {{ X }}; i++) {
    z[i] += h * total[i];
    for (j = 0; j < {{ S }}; j++) A[i * {{ S }} + j] = (real)(i == j) + h * sum[i * {{ S }} + j];
  }
}

/* State z and covariance P at the time `then` under inputs held from the time `now` on. */
static int filter_ahead(const SHIP_filter *f, const real *inputs, double now, double then, real *z, real *P) {
  const double parts = ceil((then - now) / {{ LONGEST }} - 1e-9);
  const int count = parts > 1.0 ? (int)(parts < 1e6 ? parts : 1e6) : 1;
  const double h = (then - now) / count;
  real held[{{ C }}], A[{{ S * S }}] = {0}, AP[{{ S * S }}];
  int i, j, k, n;
  memcpy(held, inputs, sizeof held);
  for (n = 0; n < count; n++) {
    held[{{ TIME }}] = now + n * h - f->began;
    linearised_step(&f->model, held, h, z, A);
    for (k = 0; k < {{ K }}; k++) {
      const int at = {{ X }} + k;
      const real left = f->noise.memories[k] > 0.0 ? exp(-h / f->noise.memories[k]) : 1.0;
      A[at * {{ S + 1 }}] = left;
      z[at] = filter_means[k] + left * (z[at] - filter_means[k]);
    }
    for (i = 0; i < {{ S }}; i++)
      for (j = 0; j < {{ S }}; j++) {
        AP[i * {{ S }} + j] = 0.0;
        for (k = i < {{ X }} ? 0 : i; k < (i < {{ X }} ? {{ S }} : i + 1); k++) AP[i * {{ S }} + j] += A[i * {{ S }} + k] * P[k * {{ S }} + j];
      }
    for (i = 0; i < {{ S }}; i++)
      for (j = 0; j <= i; j++) {
        real sum = 0.0;
        for (k = j < {{ X }} ? 0 : j; k < (j < {{ X }} ? {{ S }} : j + 1); k++) sum += AP[i * {{ S }} + k] * A[j * {{ S }} + k];
        P[i * {{ S }} + j] = P[j * {{ S }} + i] = sum;
      }
    for (k = 0; k < {{ K }}; k++) {
      const int at = ({{ X }} + k) * {{ S + 1 }};
      const real left = A[at];
      P[at] += f->noise.sizes[k] * f->noise.sizes[k] * (1.0 - left * left);
    }
  }
  return finite_numbers(z, {{ S }}) && finite_numbers(P, {{ S * S }}) ? 0 : 2;
}

/* The state at the first sample: what is not measured is 0 and as good as unknown. */
static void filter_first(SHIP_filter *f, const real *measured, const real *inputs, real *z, real *P) {
  real six[6], other[{{ S }}], held[{{ C }}], slope[6][{{ X }}];
  int i, j, k;
  memcpy(held, inputs, sizeof held);
  held[{{ TIME }}] = 0.0;
  for (i = 0; i < 6; i++) six[i] = finite_numbers(measured + i, 1) ? measured[i] : 0.0;
  SHIP_settle(&f->model, six, held, z);
  for (k = 0; k < 6; k++) {
    const real first = six[k], std = finite_numbers(measured + k, 1) ? f->noise.sensors[k] : filter_unknown[k];
    six[k] += {{ DIFFERENCE }};
    SHIP_settle(&f->model, six, held, other);
    six[k] = first;
    for (i = 0; i < {{ X }}; i++) slope[k][i] = (other[i] - z[i]) / {{ DIFFERENCE }} * std;
  }
  memset(P, 0, {{ S * S }} * sizeof *P);
  for (i = 0; i < {{ X }}; i++)
    for (j = 0; j < {{ X }}; j++)
      for (k = 0; k < 6; k++) P[i * {{ S }} + j] += slope[k][i] * slope[k][j];
{% if X > 6 %}
  for (i = 6; i < {{ X }}; i++) P[i * {{ S + 1 }}] += filter_settled[i - 6] * filter_settled[i - 6];
{% endif %}
  for (k = 0; k < {{ K }}; k++) P[({{ X }} + k) * {{ S + 1 }}] = f->noise.sizes[k] * f->noise.sizes[k];
}

/* Compares the finite numbers of a sample, whose errors count `alike` times, with the state z of covariance P. With
 * L L' the covariance of the errors and H' their derivatives, rows W of L^-1 H' P give the gain. Returns how many were
 * compared, or -1 where rounding leaves no covariance. */
static int filter_compare(const SHIP_filter *f, const real *measured, real alike, real *z, real *P, real *nis) {
  real expected[6], H[{{ 6 * S }}], L[6][6], W[6][{{ S }}], error[6];
  int good[6], count = 0, i, j, k;
  SHIP_columns(&f->model, z, expected);
  SHIP_columns_jacobian(&f->model, z, H);
  for (i = 0; i < 6; i++)
    if (finite_numbers(measured + i, 1)) good[count++] = i;
  for (i = 0; i < count; i++) {
    const real *row = H + good[i] * {{ S }};
    error[i] = measured[good[i]] - expected[good[i]];
    if (good[i] == 2) error[i] = remainder(error[i], 6.283185307179586);
    for (j = 0; j < {{ S }}; j++) {
      W[i][j] = 0.0;
      for (k = 0; k < {{ S }}; k++) W[i][j] += row[k] * P[k * {{ S }} + j];
    }
    for (j = 0; j <= i; j++) {
      L[i][j] = i == j ? alike * f->noise.sensors[good[i]] * f->noise.sensors[good[i]] : 0.0;
      for (k = 0; k < {{ S }}; k++) L[i][j] += W[i][k] * H[good[j] * {{ S }} + k];
    }
  }
  *nis = 0.0;
  for (i = 0; i < count; i++) {
    for (j = 0; j <= i; j++) {
      for (k = 0; k < j; k++) L[i][j] -= L[i][k] * L[j][k];
      if (j < i) L[i][j] /= L[j][j];
    }
    if (!(L[i][i] > 0.0)) return -1;
    L[i][i] = sqrt(L[i][i]);
    for (k = 0; k < i; k++) {
      error[i] -= L[i][k] * error[k];
      for (j = 0; j < {{ S }}; j++) W[i][j] -= L[i][k] * W[k][j];
    }
    error[i] /= L[i][i];
    *nis += error[i] * error[i];
    for (j = 0; j < {{ S }}; j++) W[i][j] /= L[i][i];
  }
  for (k = 0; k < count; k++)
    for (i = 0; i < {{ S }}; i++) {
      z[i] += W[k][i] * error[k];
      for (j = 0; j < {{ S }}; j++) P[i * {{ S }} + j] -= W[k][i] * W[k][j];
    }
  return count;
}

int SHIP_update(SHIP_filter *f, double t, const real *measured, const real *inputs) {
  real z[{{ S }}], P[{{ S * S }}], nis = 0.0;
  int compared = 0;
  if (!finite_numbers(&t, 1) || (f->samples > 0 && !(t > f->t))) return 1;
  if (!finite_numbers(inputs, {{ TIME }})) return 1;
  if (f->samples > 0) {
    const real apart = f->noise.interval / (t - f->t);
    memcpy(z, f->state, sizeof z);
    memcpy(P, f->covariance, sizeof P);
    if (filter_ahead(f, f->inputs, f->t, t, z, P)) return 2;
    compared = filter_compare(f, measured, apart > 1.0 ? apart : 1.0, z, P, &nis);
  } else {
    if (!finite_numbers(measured + 2, 1)) return 1;
    filter_first(f, measured, inputs, z, P);
  }
  if (compared < 0 || !finite_numbers(z, {{ S }}) || !finite_numbers(P, {{ S * S }})) return 2;
  if (f->samples == 0) f->began = t;
  f->samples++;
  f->t = t;
  f->nis = nis;
  f->compared = compared;
  memcpy(f->inputs, inputs, sizeof f->inputs);
  memcpy(f->state, z, sizeof z);
  memcpy(f->covariance, P, sizeof P);
  return 0;
}

int SHIP_forecast(const SHIP_filter *f, double seconds, const real *inputs, SHIP_filter *ahead) {
  real held[{{ C }}], z[{{ S }}], P[{{ S * S }}];
  const double then = f->t + seconds;
  memcpy(held, inputs ? inputs : f->inputs, sizeof held);
  if (f->samples == 0 || !finite_numbers(&seconds, 1) || !(seconds > 0.0) || !finite_numbers(held, {{ TIME }})) return 1;
  memcpy(z, f->state, sizeof z);
  memcpy(P, f->covariance, sizeof P);
  if (filter_ahead(f, held, f->t, then, z, P)) return 2;
  if (ahead != f) memcpy(ahead, f, sizeof *f);
  ahead->t = then;
  memcpy(ahead->inputs, held, sizeof held);
  memcpy(ahead->state, z, sizeof z);
  memcpy(ahead->covariance, P, sizeof P);
  return 0;
}

void SHIP_estimate(const SHIP_filter *f, real *mean, real *covariance) {
  real H[{{ M * S }}] = {0}, HP[{{ S }}];
  int i, j, k;
  SHIP_columns(&f->model, f->state, mean);
  memcpy(mean + 6, f->state + {{ X }}, {{ K }} * sizeof *mean);
  if (!covariance) return;
  SHIP_columns_jacobian(&f->model, f->state, H);
  for (k = 0; k < {{ K }}; k++) H[(6 + k) * {{ S }} + {{ X }} + k] = 1.0;
  for (i = 0; i < {{ M }}; i++) {
    for (j = 0; j < {{ S }}; j++) {
      HP[j] = 0.0;
      for (k = 0; k < {{ S }}; k++) HP[j] += H[i * {{ S }} + k] * f->covariance[k * {{ S }} + j];
    }
    for (j = 0; j < {{ M }}; j++) {
      covariance[i * {{ M }} + j] = 0.0;
      for (k = 0; k < {{ S }}; k++) covariance[i * {{ M }} + j] += HP[k] * H[j * {{ S }} + k];
    }
  }
}
