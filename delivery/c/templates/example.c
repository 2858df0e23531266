{{ ABOUT }}#include "SHIP.h"

#include <stdio.h>

int main(void) {
  SHIP_model model;
  SHIP_real columns[UPPER_COLUMNS] = {0}, inputs[UPPER_INPUTS] = {0}, state[UPPER_STATES];
  int k;
{{ SETTINGS }}  columns[SHIP_state_u] = (SHIP_real){{ SPEED }};
  SHIP_init(&model, NULL);
  SHIP_settle(&model, columns, inputs, state);
  printf("t [s],x [m],y [m],psi [rad],u [m/s],v [m/s],r [rad/s],extrapolation\n");
  for (k = 0; k <= 6000; k++) {
    if (k % 100 == 0)
      printf("%g,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g,%.3g\n", 0.1 * k, (double)state[0], (double)state[1],
        (double)state[2], (double)state[3], (double)state[4], (double)state[5],
        SHIP_extrapolation(&model, state, inputs));
{{ CLOCK }}    if (SHIP_step(&model, state, inputs, 0.1)) {
      fprintf(stderr, "the motion is not finite\n");
      return 1;
    }
  }
  return 0;
}
