
/* y = tanh(weight x + bias) - offset. tanh is p / (p + 2) with p = exp(2 x) - 1, by the series of exp(y) - 1 at
 * y = x / @SHARE@, doubled @DOUBLINGS@ times. */
static void network_@ROWS@x@COLUMNS@(const real *weight, const real *bias, const real *offset, const real *x,
  real *y) {
  int b, i, j;
  for (b = 0; b < @ROWS@; b += @BLOCK@) {
    const real *w = weight + b * @COLUMNS@;
    real @STARTS@;
    for (j = 0; j < @COLUMNS@; j++) {
      const real a = x[j];
      @SUMS@
      w += @BLOCK@;
    }
    @STORES@
  }
  for (i = 0; i < @ROWS@; i++) {
    if (y[i] > R(20.0)) y[i] = R(20.0);
    if (y[i] < R(-20.0)) y[i] = R(-20.0);
  }
  for (i = 0; i < @ROWS@; i++) {
    @TANH@
    y[i] = p / (p + R(2.0));
  }
  for (i = 0; i < @ROWS@; i++) y[i] -= offset[i];
}
