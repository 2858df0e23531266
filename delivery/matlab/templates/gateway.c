/* The ship SHIP for MATLAB and Octave, compiled: the same words as SHIP.m, and jacobians.
 *   MATLAB: mex SHIP_mex.c      Octave: mkoctfile --mex SHIP_mex.c
 * step takes several ships at once: a column of state and of inputs each. */
#include "SHIP.c"

#include "mex.h"

static const char *const coefficient_fields[] = { {{- FIELDS -}} };

/* coefficients out of the struct of parameters that SHIP() gives */
static void read_coefficients(const mxArray *given, double *coefficients) {
  const mxArray *table = mxIsStruct(given) ? mxGetField(given, 0, "coefficients") : NULL;
  int i;
  if (!table || !mxIsStruct(table))
    mexErrMsgIdAndTxt("SHIP:parameters", "the last argument must be the struct of parameters that SHIP() gives");
  for (i = 0; i < UPPER_COEFFICIENTS; i++) {
    const mxArray *row = mxGetField(table, 0, coefficient_fields[i]);
    const mxArray *value = row && mxIsStruct(row) ? mxGetField(row, 0, "value") : NULL;
    if (!value || !mxIsDouble(value) || mxIsComplex(value) || mxGetNumberOfElements(value) != 1)
      mexErrMsgIdAndTxt("SHIP:parameters", "coefficients.%s.value is missing or no number", coefficient_fields[i]);
    coefficients[i] = mxGetScalar(value);
  }
}

static const double *numbers(const mxArray *given, size_t rows, size_t columns, const char *name) {
  if (!mxIsDouble(given) || mxIsComplex(given) || mxGetNumberOfElements(given) != rows * columns)
    mexErrMsgIdAndTxt("SHIP:size", "%s must hold %d x %d real numbers", name, (int)rows, (int)columns);
  return mxGetPr(given);
}

/* rows x columns, from C's row by row to column by column */
static void turned(const double *from, double *to, int rows, int columns) {
  int i, j;
  for (i = 0; i < rows; i++)
    for (j = 0; j < columns; j++) to[j * rows + i] = from[i * columns + j];
}

void mexFunction(int left, mxArray *out[], int right, const mxArray *in[]) {
  static const char *const words[] = {"rates", "forces", "columns", "settle", "step", "extrapolation", "jacobians"};
  static const int counts[] = {2, 2, 1, 2, 3, 2, 2};
  SHIP_model model;
  double coefficients[UPPER_COEFFICIENTS], forces[3 * UPPER_ROLES], by[UPPER_STATES * UPPER_STATES];
  double with[UPPER_STATES * UPPER_INPUTS];
  const double *state, *inputs = NULL;
  char what[16];
  size_t several, i;
  int word;
  if (right < 1 || mxGetString(in[0], what, sizeof what))
    mexErrMsgIdAndTxt("SHIP:what", "the first argument is a word");
  for (word = 0; word < 7 && strcmp(what, words[word]); word++) {}
  if (word == 7)
    mexErrMsgIdAndTxt("SHIP:what", "ask for rates, forces, columns, settle, step, extrapolation, jacobians");
  if (right - 1 < counts[word] || right - 1 > counts[word] + 1 || left > (word == 6 ? 2 : 1))
    mexErrMsgIdAndTxt("SHIP:arguments", "%s takes %d arguments and the parameters", what, counts[word]);
  if (right - 1 > counts[word]) read_coefficients(in[right - 1], coefficients);
  else memcpy(coefficients, SHIP_coefficient_defaults, sizeof coefficients);
  SHIP_init(&model, coefficients);
  several = word == 4 ? mxGetN(in[1]) : 1;
  if (word == 4 && mxGetM(in[1]) != UPPER_STATES) several = 1;
  state = numbers(in[1], word == 3 ? 6 : UPPER_STATES, several, word == 3 ? "columns" : "state");
  if (word != 2) inputs = numbers(in[2], UPPER_INPUTS, several, "inputs");
  switch (word) {
    case 0:
      out[0] = mxCreateDoubleMatrix(UPPER_STATES, 1, mxREAL);
      SHIP_rates(&model, state, inputs, mxGetPr(out[0]));
      break;
    case 1:
      out[0] = mxCreateDoubleMatrix(UPPER_ROLES, 3, mxREAL);
      SHIP_forces(&model, state, inputs, forces);
      turned(forces, mxGetPr(out[0]), UPPER_ROLES, 3);
      break;
    case 2:
      out[0] = mxCreateDoubleMatrix(6, 1, mxREAL);
      SHIP_columns(&model, state, mxGetPr(out[0]));
      break;
    case 3:
      out[0] = mxCreateDoubleMatrix(UPPER_STATES, 1, mxREAL);
      SHIP_settle(&model, state, inputs, mxGetPr(out[0]));
      break;
    case 4:
      if (several > 1000000) mexErrMsgIdAndTxt("SHIP:size", "at most 1000000 ships at once");
      out[0] = mxCreateDoubleMatrix(UPPER_STATES, several, mxREAL);
      for (i = 0; i < several * UPPER_STATES; i++) mxGetPr(out[0])[i] = state[i];
      if (SHIP_step_many(&model, (int)several, mxGetPr(out[0]), inputs, *numbers(in[3], 1, 1, "h")))
        mexErrMsgIdAndTxt("SHIP:step", "the motion is not finite, or h is no step");
      break;
    case 5:
      out[0] = mxCreateDoubleScalar(SHIP_extrapolation(&model, state, inputs));
      break;
    default:
      SHIP_jacobians(&model, state, inputs, by, with);
      out[0] = mxCreateDoubleMatrix(UPPER_STATES, UPPER_STATES, mxREAL);
      turned(by, mxGetPr(out[0]), UPPER_STATES, UPPER_STATES);
      if (left > 1) {
        out[1] = mxCreateDoubleMatrix(UPPER_STATES, UPPER_INPUTS, mxREAL);
        turned(with, mxGetPr(out[1]), UPPER_STATES, UPPER_INPUTS);
      }
  }
}
