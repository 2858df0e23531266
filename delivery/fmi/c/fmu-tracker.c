/* What an instance of a filter calculates. A step takes in the sample at its begin, and goes on to its end: outputs are
   what is known there of all samples before. It waits for a heading to begin with. */

/* The filter with coefficients and noise as they are set. */
static void fmu_settle(FmuCore *c) {
  if (c->model_stale) {
    if (c->filter.samples == 0) SHIP(start)(&c->filter, c->set + FMU_INPUTS + 6);
    else SHIP(init)(&c->filter.model, c->set + FMU_INPUTS + 6);
    memcpy(&c->filter.noise, c->set + FMU_NOISE, sizeof c->filter.noise);
    c->now.model = c->filter.model;
    c->now.noise = c->filter.noise;
  }
  c->model_stale = c->state_stale = 0;
}

/* Means and standard deviations of a filter, with the errors of sensors where it tells what will be logged. */
static void fmu_known(const SHIP(filter) *filter, int logged, double *mean, double *std, size_t count) {
  double every[FMU_ESTIMATES], covariance[FMU_ESTIMATES * FMU_ESTIMATES];
  size_t i;
  SHIP(estimate)(filter, every, covariance);
  for (i = 0; i < count; i++) {
    const double sensor = logged ? filter->noise.sensors[i] : 0.0;
    mean[i] = every[i];
    std[i] = sqrt(covariance[i * (FMU_ESTIMATES + 1)] + sensor * sensor);
  }
}

static double fmu_output(FmuInstance *x, size_t k) {
  FmuCore *c = &x->core;
  double *const outputs = c->outputs;
  if (c->filter.samples == 0) return k == FMU_EXTRAPOLATION ? -1.0 : 0.0;
  if (c->forces_stale && k >= FMU_EXPECTED) { /* made when it is asked for: a forecast takes most of the time */
    SHIP(filter) later;
    fmu_settle(c);
    if (SHIP(forecast)(&c->now, c->set[FMU_HORIZON], NULL, &later) == 0) {
      fmu_known(&later, 1, outputs + FMU_EXPECTED, outputs + FMU_EXPECTED_STD, 6);
    } else {
      fmu_report(x, FMU_WARNING, "fmu_output: no forecast over %g s; the last one stays", c->set[FMU_HORIZON]);
    }
    outputs[FMU_EXTRAPOLATION] = SHIP(extrapolation)(&c->now.model, c->now.state, c->now.inputs);
    c->forces_stale = 0;
  }
  return outputs[k];
}

static FmuResult fmu_step(FmuInstance *x, const char *function, double t, double h) {
  FmuCore *c = &x->core;
  double inputs[FMU_INPUTS + 1] = {0.0}; /* the filter knows the time */
  if (fmu_step_possible(x, function, t, h) != FMU_OK) return FMU_ERROR;
  fmu_settle(c);
  memcpy(inputs, c->set, FMU_INPUTS * sizeof(double));
  if (c->filter.samples > 0 || isfinite(c->set[FMU_INPUTS + 2])) {
    if (SHIP(update)(&c->filter, t, c->set + FMU_INPUTS, inputs) || SHIP(forecast)(&c->filter, h, NULL, &c->now)) {
      return fmu_error(x, function, "the filter fails; check noise, coefficients and inputs");
    }
    fmu_known(&c->now, 0, c->outputs + FMU_ESTIMATE, c->outputs + FMU_STD, FMU_ESTIMATES);
    c->outputs[FMU_NIS] = c->filter.nis;
    c->outputs[FMU_COMPARED] = c->filter.compared;
  }
  c->time = t + h;
  fmu_stale(c);
  return FMU_OK;
}
