{% for text in ARRAYS %}{{ text }}{% endfor %}
{% for rows, columns in SHAPES %}

/* y = tanh(weight x + bias) - offset. tanh is p / (p + 2) with p = exp(2 x) - 1, by the series of exp(y) - 1 at
 * y = x / {{ SHARE }}, doubled {{ DOUBLINGS }} times. */
static void network_{{ rows }}x{{ columns }}(const real *weight, const real *bias, const real *offset, const real *x,
  real *y) {
  int b, i, j;
  for (b = 0; b < {{ rows }}; b += {{ BLOCK }}) {
    const real *w = weight + b * {{ columns }};
    real {% for i in range(BLOCK) %}s{{ i }} = bias[b + {{ i }}]{{ ", " if not loop.last }}{% endfor %};
    for (j = 0; j < {{ columns }}; j++) {
      const real a = x[j];
      {%+ for i in range(BLOCK) %}s{{ i }} += w[{{ i }}] * a;{{ " " if not loop.last }}{% endfor %}

      w += {{ BLOCK }};
    }
    {%+ for i in range(BLOCK) %}y[b + {{ i }}] = s{{ i }};{{ " " if not loop.last }}{% endfor %}

  }
  for (i = 0; i < {{ rows }}; i++) {
    if (y[i] > R(20.0)) y[i] = R(20.0);
    if (y[i] < R(-20.0)) y[i] = R(-20.0);
  }
  for (i = 0; i < {{ rows }}; i++) {
    {{ tanh('y[i]') }}
    y[i] = p / (p + R(2.0));
  }
  for (i = 0; i < {{ rows }}; i++) y[i] -= offset[i];
}
{% endfor %}
static void network_add(const real *features, real *rates) {
  real x[{{ PLACES | length }}], y[2][{{ WIDEST }}], a[4] = {R(0.0), R(0.0), R(0.0), R(0.0)};
  int i, j;
{% for place in PLACES %}
  x[{{ loop.index0 }}] = features[{{ place }}];
{% endfor %}
{% for member in MEMBERS %}
{% for layer in member.layers("y[0]", "y[1]") %}
  network_{{ layer }};
{% endfor %}
  for (j = 0; j < {{ member.width }}; j++)
    for (i = 0; i < 4; i++) a[i] += network_{{ member.number }}_last[4 * j + i] * y[{{ (member.depth - 1) % 2 }}][j];
{% endfor %}
{% for i in range(3) %}
  rates[{{ 3 + i }}] += a[{{ i }}];
{% endfor %}
}
static void network_jacobian(const real *features, real *by) {
  real x[{{ PLACES | length }}], t[{{ DEEPEST }}][{{ WIDEST }}], g[{{ 3 * WIDEST }}], k[{{ 3 * WIDEST }}];
  int i, j, l;
{% for place in PLACES %}
  x[{{ loop.index0 }}] = features[{{ place }}];
{% endfor %}
  for (i = 0; i < {{ 3 * PLACES | length }}; i++) by[i] = R(0.0);
{% for member in MEMBERS %}
{% for layer in member.layers(*T) %}
  network_{{ layer }};
{% endfor %}
  for (j = 0; j < 3; j++) for (i = 0; i < {{ member.width }}; i++)
    g[j * {{ member.width }} + i] = network_{{ member.number }}_last[4 * i + j];
{% for rows, columns in member.shapes | reverse %}
{% set depth = member.depth - loop.index %}
  for (i = 0; i < {{ rows }}; i++) {
    const real h = t[{{ depth }}][i] + network_{{ member.number }}_offset_{{ depth }}[i];
    for (j = 0; j < 3; j++) g[j * {{ rows }} + i] *= R(1.0) - h * h;
  }
  for (j = 0; j < 3; j++) for (l = 0; l < {{ columns }}; l++) {
    real sum = R(0.0);
    for (i = 0; i < {{ rows }}; i++)
      sum += g[j * {{ rows }} + i] * network_{{ member.number }}_weight_{{ depth }}[(i / {{ BLOCK }} * {{ columns }} + l) * {{ BLOCK }} + i % {{ BLOCK }}];
    k[j * {{ columns }} + l] = sum;
  }
  for (i = 0; i < {{ 3 * columns }}; i++) g[i] = k[i];
{% endfor %}
  for (i = 0; i < {{ 3 * PLACES | length }}; i++) by[i] += g[i];
{% endfor %}
}
