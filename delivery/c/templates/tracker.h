/* ---- The filter: the ship followed sample by sample (an extended Kalman filter) ------------------------------------
 * Its random states are the last {{ K }} of the state: forces X, Y [N], N [N m], a current [m/s], chosen coefficients.
 * It needs double precision, without -ffast-math: what is not measured is NaN. */
#define UPPER_RANDOM {{ K }}
#define UPPER_ESTIMATES {{ M }} /* logged x, y, psi, u, v, r, then the random states */

typedef struct {
  SHIP_real sizes[{{ K }}];    /* standard deviations of the random states */
  SHIP_real memories[{{ K }}]; /* [s] in which they fade; 0: they do not */
  SHIP_real sensors[6];  /* standard deviations of the errors of logged x, y, psi, u, v, r */
  SHIP_real interval;    /* [s]; samples nearer than this share their errors */
} SHIP_noise;

/* Written by the functions below. It holds no pointer: copy it as you like. The noise may be changed at any time. */
typedef struct {
  SHIP_model model;
  SHIP_noise noise;
  double began, t;  /* [s] times of the first sample and of the state */
  int samples;      /* that were taken in */
  int compared;     /* numbers of the last sample that were compared */
  SHIP_real nis;    /* squared distance of the last sample from what was expected: chi-square, `compared` degrees */
  SHIP_real inputs[{{ C }}], state[{{ S }}], covariance[{{ S * S }}];
} SHIP_filter;

/* To be called first, for each run. coefficients: [{{ P }}], NULL for the defaults. */
void SHIP_start(SHIP_filter *filter, const SHIP_real *coefficients);

/* Takes in a sample at time t [s]. measured: x, y, psi (wrapped or not), u, v, r [6] as logged, of which numbers that
 * are not finite are skipped; inputs [{{ C }}]: those that act from then on, the time among them is not read. Returns 0; 1
 * for a time that is not after the last sample, for inputs that are not finite and for a first sample without psi; 2
 * where the model runs away. The filter is then as before. */
int SHIP_update(SHIP_filter *filter, double t, const SHIP_real *measured, const SHIP_real *inputs);

/* The filter as it would be `seconds` later without a sample, inputs [{{ C }}] held (NULL: as they are). `ahead` may be the
 * same filter, so that a plan of inputs is a call for each part of it. Returns as SHIP_update does. */
int SHIP_forecast(const SHIP_filter *filter, double seconds, const SHIP_real *inputs, SHIP_filter *ahead);

/* What the filter knows: mean [{{ M }}] and covariance [{{ M }} x {{ M }}] (NULL: not wanted) of logged x, y, psi (continuous), u,
 * v, r and of the random states. What will be logged has the variances of the sensors in addition. */
void SHIP_estimate(const SHIP_filter *filter, SHIP_real *mean, SHIP_real *covariance);

