{{ ABOUT }}#include "SHIP.h"

#include <math.h>
#include <stdio.h>

int main(void) {
  SHIP_filter filter, later;
  SHIP_real measured[6] = {0}, inputs[UPPER_INPUTS] = {0}, mean[UPPER_ESTIMATES];
  SHIP_real covariance[UPPER_ESTIMATES * UPPER_ESTIMATES];
  int k;
{{ SETTINGS }}  SHIP_start(&filter, NULL);
  printf("t [s],u [m/s],its std [m/s],x in a minute [m],its std [m]\n");
  for (k = 0; k <= 60; k++) {
    measured[0] = {{ SPEED }} * k; /* x [m]: straight on; put what your instruments log here */
    measured[3] = k % 10 ? NAN : {{ SPEED }}; /* u [m/s] comes every ten seconds */
    if (SHIP_update(&filter, k, measured, inputs) || SHIP_forecast(&filter, 60.0, NULL, &later)) {
      fprintf(stderr, "the sample cannot be taken in\n");
      return 1;
    }
    SHIP_estimate(&filter, mean, covariance);
    printf("%d,%.9g,%.3g,", k, mean[3], sqrt(covariance[3 * UPPER_ESTIMATES + 3]));
    SHIP_estimate(&later, mean, covariance);
    printf("%.9g,%.3g\n", mean[0], sqrt(covariance[0]));
  }
  return 0;
}
