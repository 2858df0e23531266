/* Goes through the life of instances of an FMI 3.0 FMU compiled from its sources, in the right and in wrong orders.
   Returns the number of claims that do not hold, and prints each of them. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"
#include "fmu-instance.h"

static int failures;
static int messages;
#define CLAIM(what)                                   \
  do {                                                \
    if (!(what)) {                                    \
      printf("line %d: not so: %s\n", __LINE__, #what); \
      failures++;                                     \
    }                                                 \
  } while (0)

static void logger(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category, fmi3String message) {
  (void)environment, (void)status;
  if (category && message) messages++;
}

static const fmi3ValueReference inputs[] = {1, 2}, initial[] = {FMU_INPUTS + 4}, coefficient[] = {FMU_INPUTS + 7};
static const fmi3ValueReference outputs[] = {FMU_FIRST_OUTPUT, FMU_FIRST_OUTPUT + 5, FMU_FIRST_OUTPUT + FMU_FORCE,
                                             FMU_FIRST_OUTPUT + FMU_LOGGED, FMU_FIRST_OUTPUT + FMU_EXTRAPOLATION};
enum { OUTPUTS = sizeof outputs / sizeof outputs[0] };

static fmi3Instance fresh(void) {
  return fmi3InstantiateCoSimulation("ship", FMU_TOKEN, "", false, true, false, false, NULL, 0, NULL, logger, NULL);
}

static fmi3Status step(fmi3Instance c, double t, double h) {
  fmi3Boolean event = true, terminate = true, early = true;
  double last = -1.0;
  const fmi3Status status = fmi3DoStep(c, t, h, true, &event, &terminate, &early, &last);
  CLAIM(status != fmi3OK || (!event && !terminate && !early && fabs(last - t - h) < 1e-12));
  return status;
}

static fmi3Instance initialized(double speed) {
  fmi3Instance c = fresh();
  CLAIM(fmi3EnterInitializationMode(c, false, 0.0, 0.0, false, 0.0) == fmi3OK);
  CLAIM(fmi3SetFloat64(c, initial, 1, &speed, 1) == fmi3OK);
  CLAIM(fmi3ExitInitializationMode(c) == fmi3OK);
  return c;
}

static void run(fmi3Instance c, int from, int steps, double *values) {
  int k;
  for (k = from; k < from + steps; k++) {
    double u[2];
    u[0] = 8.0 + sin(0.01 * k);
    u[1] = 0.4 * sin(0.03 * k);
    CLAIM(fmi3SetFloat64(c, inputs, 2, u, 2) == fmi3OK);
    CLAIM(step(c, 0.1 * k, 0.1) == fmi3OK);
  }
  CLAIM(fmi3GetFloat64(c, outputs, OUTPUTS, values, OUTPUTS) == fmi3OK);
}

static void states(void) {
  fmi3Instance c = initialized(0.5), other = initialized(0.1);
  fmi3FMUState state = NULL, again = NULL;
  double first[OUTPUTS], second[OUTPUTS], third[OUTPUTS], start[OUTPUTS], changed;
  fmi3Byte *bytes;
  size_t size = 0, longer = 0;
  run(c, 0, 50, start);
  CLAIM(fmi3GetFMUState(c, &state) == fmi3OK);
  CLAIM(fmi3SerializedFMUStateSize(c, state, &size) == fmi3OK && size > 0);
  bytes = (fmi3Byte *)malloc(size);
  CLAIM(fmi3SerializeFMUState(c, state, bytes, size) == fmi3OK);
  run(c, 50, 50, first);
  changed = 0.9 * fmu_start[FMU_INPUTS + 6];
  CLAIM(fmi3SetFloat64(c, coefficient, 1, &changed, 1) <= fmi3Warning);
  run(c, 100, 10, second);
  CLAIM(fmi3SetFMUState(c, state) == fmi3OK);
  run(c, 50, 50, second);
  CLAIM(memcmp(first, second, sizeof first) == 0);
  CLAIM(fmi3DeserializeFMUState(other, bytes, size, &again) == fmi3OK);
  CLAIM(fmi3SetFMUState(other, again) == fmi3OK);
  run(other, 50, 50, third);
  CLAIM(memcmp(first, third, sizeof first) == 0);
  CLAIM(fmi3GetFMUState(other, &again) == fmi3OK);
  CLAIM(fmi3FreeFMUState(other, &again) == fmi3OK && again == NULL);
  CLAIM(fmi3FreeFMUState(c, &state) == fmi3OK && state == NULL);
  CLAIM(fmi3Reset(c) == fmi3OK);
  fmi3FreeInstance(c);
  c = initialized(0.5);
  run(c, 0, 5000, second);
  CLAIM(fmi3GetFMUState(c, &state) == fmi3OK);
  CLAIM(fmi3SerializedFMUStateSize(c, state, &longer) == fmi3OK && longer < size + 400 * sizeof(FmuHeld));
  CLAIM(fmi3FreeFMUState(c, &state) == fmi3OK);
  bytes[0] ^= 1;
  CLAIM(fmi3DeserializeFMUState(other, bytes, size, &again) == fmi3Error && again == NULL);
  CLAIM(fmi3Reset(other) == fmi3OK);
  bytes[0] ^= 1;
  CLAIM(fmi3DeserializeFMUState(other, bytes, size - 1, &again) == fmi3Error && again == NULL);
  CLAIM(fmi3SetFMUState(other, NULL) == fmi3Error);
  free(bytes);
  fmi3FreeInstance(c);
  fmi3FreeInstance(other);
}

#define HUNDRED 100

static void instances(void) {
  fmi3Instance all[HUNDRED];
  double values[OUTPUTS], alone[OUTPUTS];
  int i;
  for (i = 0; i < HUNDRED; i++) all[i] = initialized(0.01 * i);
  for (i = 0; i < HUNDRED; i++) run(all[i], 0, 5, values);
  for (i = 0; i < HUNDRED; i++) {
    fmi3Instance c = initialized(0.01 * i);
    run(all[i], 5, 5, values);
    run(c, 0, 10, alone);
    CLAIM(memcmp(values, alone, sizeof values) == 0);
    fmi3FreeInstance(c);
  }
  for (i = 0; i < HUNDRED; i++) fmi3FreeInstance(all[i]);
}

/* A wrong call on a fresh instance: it answers fmi3Error, and so does a step after it, until it is reset. */
#define WRONG(make, call)                                           \
  do {                                                              \
    fmi3Instance c = make;                                         \
    const int before = messages;                                    \
    CLAIM((call) == fmi3Error);                                     \
    CLAIM(messages > before);                                       \
    CLAIM(step(c, 0.0, 0.1) == fmi3Error);          \
    CLAIM(fmi3Reset(c) == fmi3OK);                                  \
    CLAIM(fmi3EnterInitializationMode(c, false, 0.0, 0.0, false, 0.0) == fmi3OK); \
    fmi3FreeInstance(c);                                            \
  } while (0)

static fmi3Instance initializing(void) {
  fmi3Instance c = fresh();
  fmi3EnterInitializationMode(c, false, 0.0, 5.0, true, 5.25);
  return c;
}

static fmi3Instance stepping(void) {
  fmi3Instance c = initializing();
  fmi3ExitInitializationMode(c);
  return c;
}

static fmi3Instance terminated(void) {
  fmi3Instance c = stepping();
  fmi3Terminate(c);
  return c;
}

static void wrong_calls(void) {
  double x = 0.0, many[3] = {0.0, 0.0, 0.0};
  fmi3Boolean yes = true;
  fmi3Int32 whole = 0;
  fmi3String text = "";
  size_t size = 0;
  const fmi3ValueReference output = FMU_FIRST_OUTPUT, none = 100000, valid = FMU_VALID, start = FMU_INPUTS + 1, time = 0;
  WRONG(fresh(), fmi3ExitInitializationMode(c));
  WRONG(fresh(), step(c, 0.0, 0.1));
  WRONG(fresh(), fmi3Terminate(c));
  WRONG(fresh(), fmi3EnterStepMode(c));
  WRONG(fresh(), fmi3EnterConfigurationMode(c));
  WRONG(fresh(), fmi3EnterInitializationMode(c, false, 0.0, (double)NAN, false, 0.0));
  WRONG(fresh(), fmi3EnterInitializationMode(c, false, 0.0, 1.0, true, 0.0));
  WRONG(initializing(), fmi3EnterInitializationMode(c, false, 0.0, 0.0, false, 0.0));
  WRONG(initializing(), step(c, 5.0, 0.1));
  WRONG(initializing(), fmi3Terminate(c));
  WRONG(initializing(), fmi3EnterEventMode(c));
  WRONG(stepping(), fmi3EnterInitializationMode(c, false, 0.0, 0.0, false, 0.0));
  WRONG(stepping(), fmi3ExitInitializationMode(c));
  WRONG(stepping(), fmi3EnterEventMode(c));
  WRONG(stepping(), fmi3EnterStepMode(c));
  WRONG(stepping(), fmi3EnterContinuousTimeMode(c));
  WRONG(stepping(), fmi3ExitConfigurationMode(c));
  WRONG(stepping(), fmi3SetTime(c, 0.0));
  WRONG(stepping(), fmi3GetNumberOfContinuousStates(c, &size));
  WRONG(stepping(), step(c, 5.0, 0.0));
  WRONG(stepping(), step(c, 5.0, -0.1));
  WRONG(stepping(), step(c, 5.0, (double)NAN));
  WRONG(stepping(), step(c, 7.0, 0.1));
  WRONG(stepping(), step(c, 5.0, 0.5));
  WRONG(stepping(), fmi3DoStep(c, 5.0, 0.1, true, NULL, NULL, NULL, NULL));
  WRONG(stepping(), fmi3SetFloat64(c, &output, 1, &x, 1));
  WRONG(stepping(), fmi3SetFloat64(c, &start, 1, &x, 1));
  WRONG(stepping(), fmi3SetFloat64(c, &none, 1, &x, 1));
  WRONG(stepping(), fmi3SetFloat64(c, &time, 1, &x, 1));
  WRONG(stepping(), fmi3SetFloat64(c, inputs, 2, many, 3));
  WRONG(stepping(), fmi3SetFloat64(c, inputs, 2, NULL, 2));
  WRONG(stepping(), fmi3GetFloat64(c, &none, 1, &x, 1));
  WRONG(stepping(), fmi3GetFloat64(c, &valid, 1, &x, 1));
  WRONG(stepping(), fmi3GetFloat64(c, inputs, 2, many, 1));
  WRONG(stepping(), fmi3GetBoolean(c, &output, 1, &yes, 1));
  WRONG(stepping(), fmi3SetBoolean(c, &valid, 1, &yes, 1));
  WRONG(stepping(), fmi3GetInt32(c, &output, 1, &whole, 1));
  WRONG(stepping(), fmi3SetInt32(c, inputs, 1, &whole, 1));
  WRONG(stepping(), fmi3GetString(c, &output, 1, &text, 1));
  WRONG(stepping(), fmi3GetClock(c, &output, 1, &yes));
  WRONG(stepping(), fmi3GetDirectionalDerivative(c, &output, 1, inputs, 1, many, 1, &x, 1));
  WRONG(stepping(), fmi3GetOutputDerivatives(c, &output, 1, &whole, many, 1));
  WRONG(stepping(), fmi3GetFMUState(c, NULL));
  WRONG(terminated(), step(c, 5.0, 0.1));
  WRONG(terminated(), fmi3SetFloat64(c, inputs, 2, many, 2));
  WRONG(terminated(), fmi3Terminate(c));
  WRONG(terminated(), fmi3ExitInitializationMode(c));
  {
    fmi3Instance c = terminated();
    CLAIM(fmi3GetFloat64(c, &output, 1, &x, 1) == fmi3OK);
    CLAIM(fmi3GetFloat64(c, &time, 1, &x, 1) == fmi3OK && x == 5.0);
    CLAIM(fmi3GetBoolean(c, &valid, 1, &yes, 1) == fmi3OK);
    fmi3FreeInstance(c);
    c = fresh();
    CLAIM(fmi3GetFloat64(c, &start, 1, &x, 1) == fmi3OK && x == fmu_start[FMU_INPUTS]);
    fmi3FreeInstance(c);
  }
  CLAIM(fmi3Terminate(NULL) == fmi3Error);
  fmi3FreeInstance(NULL);
}

static void refused_instances(void) {
  const int before = messages;
  CLAIM(!fmi3InstantiateModelExchange("ship", FMU_TOKEN, "", false, false, NULL, logger));
  CLAIM(!fmi3InstantiateScheduledExecution("ship", FMU_TOKEN, "", false, false, NULL, logger, NULL, NULL, NULL));
  CLAIM(!fmi3InstantiateCoSimulation("s", "{another}", "", false, false, false, false, NULL, 0, NULL, logger, NULL));
  CLAIM(!fmi3InstantiateCoSimulation("", FMU_TOKEN, "", false, false, false, false, NULL, 0, NULL, logger, NULL));
  CLAIM(!fmi3InstantiateCoSimulation("s", FMU_TOKEN, "", false, false, true, false, NULL, 0, NULL, logger, NULL));
  CLAIM(!fmi3InstantiateCoSimulation("s", NULL, "", false, false, false, false, NULL, 0, NULL, NULL, NULL));
  CLAIM(messages == before + 5);
}

static void values(void) {
  fmi3Instance c = initialized(0.5);
  double bad = (double)NAN, out[OUTPUTS], before[OUTPUTS], high = fmu_upper[0] * 2 + 1;
  run(c, 0, 3, before);
  CLAIM(fmi3SetFloat64(c, inputs, 1, &bad, 1) == fmi3Discard);
  CLAIM(fmi3SetFloat64(c, coefficient, 1, &bad, 1) == fmi3Discard);
  CLAIM(fmi3GetFloat64(c, outputs, OUTPUTS, out, OUTPUTS) == fmi3OK);
  CLAIM(memcmp(out, before, sizeof out) == 0);
  CLAIM(fmi3SetFloat64(c, coefficient, 1, &high, 1) == (fmu_upper[0] < 1e300 ? fmi3Warning : fmi3OK));
  CLAIM(fmi3GetFloat64(c, coefficient, 1, out, 1) == fmi3OK && out[0] == high);
  CLAIM(fmi3SetDebugLogging(c, false, 0, NULL) == fmi3OK);
  CLAIM(fmi3Terminate(c) == fmi3OK);
  fmi3FreeInstance(c);
  CLAIM(strcmp(fmi3GetVersion(), "3.0") == 0);
}

int main(void) {
  states();
  instances();
  wrong_calls();
  refused_instances();
  values();
  printf("%d claims do not hold\n", failures);
  return failures > 0;
}
