/* See fmu-instance.h. What is calculated, and how a step is taken, follows in fmu-ship.c or fmu-tracker.c. */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmu-instance.h"

#define FMU_LONGEST_NAME 256

static void fmu_settle(FmuCore *c); /* before the first step: what follows from all that can be set */
static double fmu_output(FmuInstance *x, size_t k);

static void fmu_report(FmuInstance *x, FmuResult status, const char *format, ...) {
  static const char *const categories[] = {"logAll", "logStatusWarning", "logStatusDiscard", "logStatusError"};
  char text[512];
  va_list arguments;
  if (!x->say || (status == FMU_OK && !x->debug)) return;
  va_start(arguments, format);
  vsnprintf(text, sizeof text, format, arguments);
  va_end(arguments);
  x->say(x, status, categories[status], text);
}

/* An error ends the simulation: from now on the instance can be read, restored, reset and freed. */
static FmuResult fmu_error(FmuInstance *x, const char *function, const char *why) {
  fmu_report(x, FMU_ERROR, "%s: %s", function, why);
  x->core.phase = FMU_FAILED;
  return FMU_ERROR;
}

static const char *fmu_phase_name(int phase) {
  switch (phase) {
    case FMU_INSTANTIATED: return "instantiated";
    case FMU_INITIALIZATION: return "in initialization mode";
    case FMU_STEPPING: return "initialized";
    case FMU_TERMINATED: return "terminated";
    default: return "in error";
  }
}

static FmuResult fmu_allowed(FmuInstance *x, const char *function, int phases) {
  char why[96];
  if (x->core.phase & phases) return FMU_OK;
  snprintf(why, sizeof why, "must not be called while the instance is %s", fmu_phase_name(x->core.phase));
  return fmu_error(x, function, why);
}

static void fmu_stale(FmuCore *c) { c->forces_stale = c->columns_stale = c->extrapolation_stale = 1; }

static void fmu_reset(FmuInstance *x) {
  FmuCore *c = &x->core;
  memset(c, 0, sizeof *c);
  memcpy(c->set, fmu_start, sizeof fmu_start);
  c->phase = FMU_INSTANTIATED;
  c->model_stale = c->state_stale = 1;
  fmu_stale(c);
  x->held = 0;
}

static void fmu_free(FmuInstance *x) {
  void (*release)(void *) = x->release;
  if (x->history) release(x->history);
  if (x->name) release(x->name);
  release(x);
}

static FmuInstance *fmu_new(const char *name, void *(*allocate)(size_t, size_t), void (*release)(void *)) {
  const size_t length = strlen(name) < FMU_LONGEST_NAME ? strlen(name) : FMU_LONGEST_NAME;
  FmuInstance *x = (FmuInstance *)allocate(1, sizeof *x);
  if (!x) return NULL;
  memset(x, 0, sizeof *x);
  x->allocate = allocate;
  x->release = release;
  x->name = (char *)allocate(length + 1, 1);
  if (!x->name) {
    release(x);
    return NULL;
  }
  memcpy(x->name, name, length);
  x->name[length] = '\0';
  fmu_reset(x);
  return x;
}

static FmuResult fmu_get(FmuInstance *x, const char *function, const unsigned *references, size_t n, double *values) {
  FmuCore *c = &x->core;
  size_t i;
  if (n && (!references || !values)) return fmu_error(x, function, "an array is missing");
  if (c->state_stale) fmu_settle(c);
  for (i = 0; i < n; i++) {
    const size_t k = references[i];
    if (k >= FMU_FIRST_OUTPUT && k < FMU_VALID) {
      values[i] = fmu_output(x, k - FMU_FIRST_OUTPUT);
    } else if (k >= 1 && k < FMU_FIRST_OUTPUT) {
      values[i] = c->set[k - 1];
    } else if (k == 0) {
      values[i] = c->time;
    } else {
      return fmu_error(x, function, "there is no such real variable");
    }
  }
  return FMU_OK;
}

/* Whether the state is finite and inside what the trials held. */
static int fmu_valid(FmuInstance *x) {
  if (x->core.state_stale) fmu_settle(&x->core);
  return fmu_output(x, FMU_EXTRAPOLATION) == 0.0;
}

static FmuResult fmu_set(FmuInstance *x, const char *function, const unsigned *references, size_t n,
                         const double *values) {
  FmuCore *c = &x->core;
  FmuResult result = FMU_OK;
  size_t i;
  if (n && (!references || !values)) return fmu_error(x, function, "an array is missing");
  for (i = 0; i < n; i++) { /* all or nothing */
    const size_t k = (size_t)references[i] - 1;
    if (references[i] == 0 || k >= FMU_SET) return fmu_error(x, function, "there is no such variable that can be set");
    const int six = k >= FMU_INPUTS && k < FMU_INPUTS + 6;
    if (six && !FMU_TRACKS && c->phase == FMU_STEPPING) {
      return fmu_error(x, function, "initial values are fixed once the instance is initialized");
    }
    if (!isfinite(values[i]) && !(six && FMU_TRACKS)) {
      fmu_report(x, FMU_DISCARD, "%s: the value of #%u# is not finite; nothing is set", function, references[i]);
      return FMU_DISCARD;
    }
  }
  for (i = 0; i < n; i++) {
    const size_t k = (size_t)references[i] - 1;
    if (c->set[k] == values[i]) continue;
    c->set[k] = values[i];
    if (k >= FMU_INPUTS + 6) {
      const size_t j = k - FMU_INPUTS - 6;
      c->model_stale = c->columns_stale = 1;
      if (values[i] < fmu_lower[j] || values[i] > fmu_upper[j]) {
        fmu_report(x, FMU_WARNING, "%s: the value of #%u# lies outside its bounds %g .. %g", function, references[i],
                   fmu_lower[j], fmu_upper[j]);
        result = FMU_WARNING;
      }
    }
    if (c->phase & (FMU_INSTANTIATED | FMU_INITIALIZATION)) c->state_stale = 1;
#if !FMU_DELAYED && !FMU_TRACKS
    if (k < FMU_ACTUATORS) c->acting[k] = values[i];
#endif
    c->forces_stale = c->extrapolation_stale = 1;
  }
  return result;
}

/* Whether a step of h [s] may begin at t. */
static FmuResult fmu_step_possible(FmuInstance *x, const char *function, double t, double h) {
  const FmuCore *c = &x->core;
  char why[160];
  if (!isfinite(t) || !isfinite(h) || h <= 0.0) return fmu_error(x, function, "the step size must be positive");
  if (fabs(t - c->time) > 1e-3 * h + 1e-9 * fabs(t)) {
    snprintf(why, sizeof why, "begins at %.17g s, but the instance is at %.17g s", t, c->time);
    return fmu_error(x, function, why);
  }
  if (c->limited && t + h > c->stop + 1e-3 * h + 1e-9 * fabs(c->stop)) {
    snprintf(why, sizeof why, "ends at %.17g s, after the stop time %.17g s", t + h, c->stop);
    return fmu_error(x, function, why);
  }
  return FMU_OK;
}

/* Saved states: the token of the model, the core, and the history. */
#define FMU_HEAD (sizeof FMU_TOKEN + sizeof(size_t))

static FmuResult fmu_save(FmuInstance *x, const char *function, void **state) {
  const size_t held = x->held, bytes = FMU_HEAD + sizeof(FmuCore) + held * sizeof(FmuHeld);
  FmuState *s;
  if (!state) return fmu_error(x, function, "the argument is missing");
  s = (FmuState *)*state;
  if (s && s->bytes != bytes) {
    x->release(s);
    s = NULL;
  }
  if (!s) s = (FmuState *)x->allocate(1, sizeof(FmuState) + bytes);
  *state = s;
  if (!s) return fmu_error(x, function, "out of memory");
  s->bytes = bytes;
  memcpy(s->data, FMU_TOKEN, sizeof FMU_TOKEN);
  memcpy(s->data + sizeof FMU_TOKEN, &held, sizeof held);
  memcpy(s->data + FMU_HEAD, &x->core, sizeof x->core);
  if (held) memcpy(s->data + FMU_HEAD + sizeof x->core, x->history, held * sizeof(FmuHeld));
  return FMU_OK;
}

/* Number of history entries in a saved state of this model, or -1 for bytes that are none. */
static long fmu_state_held(const unsigned char *data, size_t bytes) {
  size_t held;
  if (bytes < FMU_HEAD + sizeof(FmuCore) || memcmp(data, FMU_TOKEN, sizeof FMU_TOKEN) != 0) return -1;
  memcpy(&held, data + sizeof FMU_TOKEN, sizeof held);
  if (held > bytes / sizeof(FmuHeld) || bytes != FMU_HEAD + sizeof(FmuCore) + held * sizeof(FmuHeld)) return -1;
  return (long)held;
}

static FmuResult fmu_restore(FmuInstance *x, const char *function, const void *state) {
  const FmuState *s = (const FmuState *)state;
  const long found = s ? fmu_state_held(s->data, s->bytes) : -1;
  const size_t held = (size_t)found;
  if (found < 0) return fmu_error(x, function, "this is no state of this model");
  if (held > x->room) {
    FmuHeld *larger = (FmuHeld *)x->allocate(held, sizeof(FmuHeld));
    if (!larger) return fmu_error(x, function, "out of memory");
    if (x->history) x->release(x->history);
    x->history = larger;
    x->room = held;
  }
  memcpy(&x->core, s->data + FMU_HEAD, sizeof x->core);
  if (held) memcpy(x->history, s->data + FMU_HEAD + sizeof x->core, held * sizeof(FmuHeld));
  x->held = held;
  return FMU_OK;
}

static FmuResult fmu_free_state(FmuInstance *x, const char *function, void **state) {
  if (!state) return fmu_error(x, function, "the argument is missing");
  if (*state) x->release(*state);
  *state = NULL;
  return FMU_OK;
}

static FmuResult fmu_state_size(FmuInstance *x, const char *function, const void *state, size_t *size) {
  if (!state || !size) return fmu_error(x, function, "the argument is missing");
  *size = ((const FmuState *)state)->bytes;
  return FMU_OK;
}

static FmuResult fmu_serialize(FmuInstance *x, const char *function, const void *state, void *bytes, size_t size) {
  const FmuState *s = (const FmuState *)state;
  if (!s || !bytes || size < s->bytes) return fmu_error(x, function, "the array is missing or too short");
  memcpy(bytes, s->data, s->bytes);
  return FMU_OK;
}

static FmuResult fmu_deserialize(FmuInstance *x, const char *function, const void *bytes, size_t size, void **state) {
  FmuState *s;
  if (!bytes || !state || fmu_state_held((const unsigned char *)bytes, size) < 0) {
    return fmu_error(x, function, "these bytes are no state of this model");
  }
  s = (FmuState *)x->allocate(1, sizeof(FmuState) + size);
  if (!s) return fmu_error(x, function, "out of memory");
  s->bytes = size;
  memcpy(s->data, bytes, size);
  *state = s;
  return FMU_OK;
}
