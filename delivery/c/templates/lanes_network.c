
/* {{ LANES }} numbers as one, where the compiler has such types; loops over them elsewhere */
#if defined(__clang__) || (defined(__GNUC__) && __GNUC__ >= 5)
typedef real lane_group __attribute__((vector_size({{ LANES }} * sizeof(real)), aligned(sizeof(real)), may_alias));
#define GROUPED 1
#else
#define GROUPED 0
#endif

static void lanes_layer(const real *weight, const real *bias, const real *offset, int rows, int columns,
  real x[][{{ LANES }}], real y[][{{ LANES }}]) {
  int b, i, j, l;
  for (b = 0; b < rows; b += 4) {
    const real *w = weight + b / {{ BLOCK }} * columns * {{ BLOCK }} + b % {{ BLOCK }};
#if GROUPED
    const lane_group zero = *(const lane_group *)x[0] * R(0.0);
    lane_group s0 = zero + bias[b], s1 = zero + bias[b + 1], s2 = zero + bias[b + 2], s3 = zero + bias[b + 3];
    for (j = 0; j < columns; j++) {
      const lane_group a = *(const lane_group *)x[j];
      s0 += w[0] * a; s1 += w[1] * a; s2 += w[2] * a; s3 += w[3] * a;
      w += {{ BLOCK }};
    }
    *(lane_group *)y[b] = s0; *(lane_group *)y[b + 1] = s1; *(lane_group *)y[b + 2] = s2; *(lane_group *)y[b + 3] = s3;
#else
    real s0[{{ LANES }}], s1[{{ LANES }}], s2[{{ LANES }}], s3[{{ LANES }}];
    for (l = 0; l < {{ LANES }}; l++) { s0[l] = bias[b]; s1[l] = bias[b + 1]; s2[l] = bias[b + 2]; s3[l] = bias[b + 3]; }
    for (j = 0; j < columns; j++) {
      const real w0 = w[0], w1 = w[1], w2 = w[2], w3 = w[3];
      for (l = 0; l < {{ LANES }}; l++) {
        const real a = x[j][l];
        s0[l] += w0 * a; s1[l] += w1 * a; s2[l] += w2 * a; s3[l] += w3 * a;
      }
      w += {{ BLOCK }};
    }
    for (l = 0; l < {{ LANES }}; l++) { y[b][l] = s0[l]; y[b + 1][l] = s1[l]; y[b + 2][l] = s2[l]; y[b + 3][l] = s3[l]; }
#endif
  }
  for (i = 0; i < rows; i++) {
    const real o = offset[i];
    real *s = y[i];
    for (l = 0; l < {{ LANES }}; l++) {
      if (s[l] > R(20.0)) s[l] = R(20.0);
      if (s[l] < R(-20.0)) s[l] = R(-20.0);
    }
#if GROUPED
    {
      {{ tanh('(*(const lane_group *)s)') | replace('real ', 'lane_group ') }}
      *(lane_group *)s = p / (p + R(2.0)) - o;
    }
#else
    for (l = 0; l < {{ LANES }}; l++) {
      {{ tanh('s[l]') }}
      s[l] = p / (p + R(2.0)) - o;
    }
#endif
  }
}
#undef GROUPED

static void lanes_network(real x[][{{ LANES }}], real rates[][{{ LANES }}]) {
  real a[3][{{ LANES }}], y[2][{{ WIDEST }}][{{ LANES }}];
  int i, j, l;
  for (i = 0; i < 3; i++) for (l = 0; l < {{ LANES }}; l++) a[i][l] = R(0.0);
{% for member in MEMBERS %}
{% for layer in member.lane_layers %}
  lanes_{{ layer }};
{% endfor %}
  for (j = 0; j < {{ member.width }}; j++) for (i = 0; i < 3; i++) for (l = 0; l < {{ LANES }}; l++)
    a[i][l] += network_{{ member.number }}_last[4 * j + i] * y[{{ (member.depth - 1) % 2 }}][j][l];
{% endfor %}
  for (i = 0; i < 3; i++) for (l = 0; l < {{ LANES }}; l++) rates[3 + i][l] += a[i][l];
}

