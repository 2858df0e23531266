{{ ABOUT }}#ifndef UPPER_H
#define UPPER_H

#ifdef __cplusplus
extern "C" {
#endif

/* define UPPER_SINGLE, here and where the source is compiled, for single precision */
#ifdef UPPER_SINGLE
typedef float SHIP_real;
#else
typedef double SHIP_real;
#endif

{{ SIZES }}#define UPPER_LONGEST_STEP {{ LONGEST_STEP }} /* [s] of one Runge-Kutta step */

/* places in state, inputs and forces */
{{ PLACES }}
/* Coefficients, and what follows from them alone. It holds no pointer: copy it as you like. Functions that take a
 * const model may be called by several threads at once. */
typedef struct {
  SHIP_real coefficients[{{ P1 }}];
  SHIP_real kept[{{ KEPT }}];
} SHIP_model;

/* To be called first, and again when a coefficient changes. coefficients: [{{ P }}], NULL for the defaults. */
void SHIP_init(SHIP_model *model, const SHIP_real *coefficients);

/* The state [{{ S }}] whose logged columns x, y, psi, u, v, r are these [6] and whose memory is settled. */
void SHIP_settle(const SHIP_model *model, const SHIP_real *columns, const SHIP_real *inputs, SHIP_real *state);

/* d state / dt [{{ S }}] */
void SHIP_rates(const SHIP_model *model, const SHIP_real *state, const SHIP_real *inputs, SHIP_real *rates);

/* X, Y [N], N [N m] of each role, [{{ R }} x 3] row by row; the accelerations of a network are not among them */
void SHIP_forces(const SHIP_model *model, const SHIP_real *state, const SHIP_real *inputs, SHIP_real *forces);

/* x, y, psi, u, v, r as the ship's instruments log them */
void SHIP_columns(const SHIP_model *model, const SHIP_real *state, SHIP_real *columns);

/* derivatives of the logged columns, row by row: by_state[6 x {{ S }}] */
void SHIP_columns_jacobian(const SHIP_model *model, const SHIP_real *state, SHIP_real *by_state);

/* derivatives of the rates, row by row: by_state[{{ S }} x {{ S }}], by_inputs[{{ S }} x {{ C }}] */
void SHIP_jacobians(const SHIP_model *model, const SHIP_real *state, const SHIP_real *inputs, SHIP_real *by_state,
  SHIP_real *by_inputs);

/* The state h seconds later, inputs held: classical Runge-Kutta steps of equal length, none longer than
 * UPPER_LONGEST_STEP. Returns 0; 1 where the new state is not finite, or h is negative, not finite or longer than
 * a million steps: the state is then as before. */
int SHIP_step(const SHIP_model *model, SHIP_real *state, const SHIP_real *inputs, double h);

/* The same for several ships of one model: states [count x {{ S }}], inputs [count x {{ C }}], ship by ship.
 * Returns the number of ships whose step failed. */
int SHIP_step_many(const SHIP_model *model, int count, SHIP_real *states, const SHIP_real *inputs, double h);

/* 0 where state and inputs lie inside what the trials held; outside the largest distance over the width of the range
 * (a width below a tenth of the values themselves counts as that); -1 where no range is known; DBL_MAX
 * where the state is not finite */
double SHIP_extrapolation(const SHIP_model *model, const SHIP_real *state, const SHIP_real *inputs);

{{ MORE }}/* Of bounds DBL_MAX is none; of standard deviations -1 is not known. */
{{ TABLES }}extern const char SHIP_about[];

#ifdef __cplusplus
}
#endif
#endif
