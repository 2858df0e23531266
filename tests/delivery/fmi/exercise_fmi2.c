/* Goes through the life of instances of an FMI 2.0 FMU compiled from its sources, in the right and in wrong orders.
   Returns the number of claims that do not hold, and prints each of them. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"
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

static void logger(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                   fmi2String message, ...) {
  (void)environment, (void)status;
  if (name && category && message) messages++;
}

static const fmi2CallbackFunctions callbacks = {logger, calloc, free, NULL, NULL};
static const fmi2ValueReference inputs[] = {1, 2}, initial[] = {FMU_INPUTS + 4}, coefficient[] = {FMU_INPUTS + 7};
static const fmi2ValueReference outputs[] = {FMU_FIRST_OUTPUT, FMU_FIRST_OUTPUT + 5, FMU_FIRST_OUTPUT + FMU_FORCE,
                                             FMU_FIRST_OUTPUT + FMU_LOGGED, FMU_FIRST_OUTPUT + FMU_EXTRAPOLATION};
enum { OUTPUTS = sizeof outputs / sizeof outputs[0] };

static fmi2Component fresh(void) {
  return fmi2Instantiate("ship", fmi2CoSimulation, FMU_TOKEN, "", &callbacks, fmi2False, fmi2True);
}

static fmi2Component initialized(double speed) {
  fmi2Component c = fresh();
  CLAIM(fmi2SetupExperiment(c, fmi2False, 0.0, 0.0, fmi2False, 0.0) == fmi2OK);
  CLAIM(fmi2EnterInitializationMode(c) == fmi2OK);
  CLAIM(fmi2SetReal(c, initial, 1, &speed) == fmi2OK);
  CLAIM(fmi2ExitInitializationMode(c) == fmi2OK);
  return c;
}

static void run(fmi2Component c, int from, int steps, double *values) {
  int k;
  for (k = from; k < from + steps; k++) {
    double u[2];
    u[0] = 8.0 + sin(0.01 * k);
    u[1] = 0.4 * sin(0.03 * k);
    CLAIM(fmi2SetReal(c, inputs, 2, u) == fmi2OK);
    CLAIM(fmi2DoStep(c, 0.1 * k, 0.1, fmi2True) == fmi2OK);
  }
  CLAIM(fmi2GetReal(c, outputs, OUTPUTS, values) == fmi2OK);
}

static void states(void) {
  fmi2Component c = initialized(0.5), other = initialized(0.1);
  fmi2FMUstate state = NULL, again = NULL;
  double first[OUTPUTS], second[OUTPUTS], third[OUTPUTS], start[OUTPUTS], changed;
  fmi2Byte *bytes;
  size_t size = 0, longer = 0;
  run(c, 0, 50, start);
  CLAIM(fmi2GetFMUstate(c, &state) == fmi2OK);
  CLAIM(fmi2SerializedFMUstateSize(c, state, &size) == fmi2OK && size > 0);
  bytes = (fmi2Byte *)malloc(size);
  CLAIM(fmi2SerializeFMUstate(c, state, bytes, size) == fmi2OK);
  run(c, 50, 50, first);
  changed = 0.9 * fmu_start[FMU_INPUTS + 6];
  CLAIM(fmi2SetReal(c, coefficient, 1, &changed) <= fmi2Warning);
  run(c, 100, 10, second);
  CLAIM(fmi2SetFMUstate(c, state) == fmi2OK);
  run(c, 50, 50, second);
  CLAIM(memcmp(first, second, sizeof first) == 0);
  CLAIM(fmi2DeSerializeFMUstate(other, bytes, size, &again) == fmi2OK);
  CLAIM(fmi2SetFMUstate(other, again) == fmi2OK);
  run(other, 50, 50, third);
  CLAIM(memcmp(first, third, sizeof first) == 0);
  CLAIM(fmi2GetFMUstate(other, &again) == fmi2OK);
  CLAIM(fmi2FreeFMUstate(other, &again) == fmi2OK && again == NULL);
  CLAIM(fmi2FreeFMUstate(c, &state) == fmi2OK && state == NULL);
  CLAIM(fmi2Reset(c) == fmi2OK);
  fmi2FreeInstance(c);
  c = initialized(0.5);
  run(c, 0, 5000, second);
  CLAIM(fmi2GetFMUstate(c, &state) == fmi2OK);
  CLAIM(fmi2SerializedFMUstateSize(c, state, &longer) == fmi2OK && longer < size + 400 * sizeof(FmuHeld));
  CLAIM(fmi2FreeFMUstate(c, &state) == fmi2OK);
  bytes[0] ^= 1;
  CLAIM(fmi2DeSerializeFMUstate(other, bytes, size, &again) == fmi2Error && again == NULL);
  CLAIM(fmi2Reset(other) == fmi2OK);
  bytes[0] ^= 1;
  CLAIM(fmi2DeSerializeFMUstate(other, bytes, size - 1, &again) == fmi2Error && again == NULL);
  CLAIM(fmi2SetFMUstate(other, NULL) == fmi2Error);
  free(bytes);
  fmi2FreeInstance(c);
  fmi2FreeInstance(other);
}

#define HUNDRED 100

static void instances(void) {
  fmi2Component all[HUNDRED];
  double values[OUTPUTS], alone[OUTPUTS];
  int i;
  for (i = 0; i < HUNDRED; i++) all[i] = initialized(0.01 * i);
  for (i = 0; i < HUNDRED; i++) run(all[i], 0, 5, values);
  for (i = 0; i < HUNDRED; i++) {
    fmi2Component c = initialized(0.01 * i);
    run(all[i], 5, 5, values);
    run(c, 0, 10, alone);
    CLAIM(memcmp(values, alone, sizeof values) == 0);
    fmi2FreeInstance(c);
  }
  for (i = 0; i < HUNDRED; i++) fmi2FreeInstance(all[i]);
}

/* A wrong call on a fresh instance: it answers fmi2Error, and so does a step after it, until it is reset. */
#define WRONG(make, call)                                           \
  do {                                                              \
    fmi2Component c = make;                                         \
    const int before = messages;                                    \
    CLAIM((call) == fmi2Error);                                     \
    CLAIM(messages > before);                                       \
    CLAIM(fmi2DoStep(c, 0.0, 0.1, fmi2True) == fmi2Error);          \
    CLAIM(fmi2Reset(c) == fmi2OK);                                  \
    CLAIM(fmi2SetupExperiment(c, fmi2False, 0.0, 0.0, fmi2False, 0.0) == fmi2OK); \
    fmi2FreeInstance(c);                                            \
  } while (0)

static fmi2Component initializing(void) {
  fmi2Component c = fresh();
  fmi2SetupExperiment(c, fmi2False, 0.0, 5.0, fmi2True, 5.25);
  fmi2EnterInitializationMode(c);
  return c;
}

static fmi2Component stepping(void) {
  fmi2Component c = initializing();
  fmi2ExitInitializationMode(c);
  return c;
}

static fmi2Component terminated(void) {
  fmi2Component c = stepping();
  fmi2Terminate(c);
  return c;
}

static void wrong_calls(void) {
  double x = 0.0, many[3] = {0.0, 0.0, 0.0};
  int whole = 0;
  fmi2String text = "";
  fmi2Status status;
  const fmi2ValueReference output = FMU_FIRST_OUTPUT, none = 100000, valid = FMU_VALID, start = FMU_INPUTS + 1, time = 0;
  WRONG(fresh(), fmi2EnterInitializationMode(c));
  WRONG(fresh(), fmi2ExitInitializationMode(c));
  WRONG(fresh(), fmi2DoStep(c, 0.0, 0.1, fmi2True));
  WRONG(fresh(), fmi2Terminate(c));
  WRONG(fresh(), fmi2GetReal(c, &output, 1, &x));
  WRONG(fresh(), fmi2GetBoolean(c, &valid, 1, &whole));
  WRONG(fresh(), fmi2CancelStep(c));
  WRONG(fresh(), fmi2SetupExperiment(c, fmi2False, 0.0, (double)NAN, fmi2False, 0.0));
  WRONG(fresh(), fmi2SetupExperiment(c, fmi2False, 0.0, 1.0, fmi2True, 0.0));
  WRONG(initializing(), fmi2SetupExperiment(c, fmi2False, 0.0, 0.0, fmi2False, 0.0));
  WRONG(initializing(), fmi2EnterInitializationMode(c));
  WRONG(initializing(), fmi2DoStep(c, 5.0, 0.1, fmi2True));
  WRONG(initializing(), fmi2Terminate(c));
  WRONG(stepping(), fmi2EnterInitializationMode(c));
  WRONG(stepping(), fmi2ExitInitializationMode(c));
  WRONG(stepping(), fmi2SetupExperiment(c, fmi2False, 0.0, 0.0, fmi2False, 0.0));
  WRONG(stepping(), fmi2DoStep(c, 5.0, 0.0, fmi2True));
  WRONG(stepping(), fmi2DoStep(c, 5.0, -0.1, fmi2True));
  WRONG(stepping(), fmi2DoStep(c, 5.0, (double)NAN, fmi2True));
  WRONG(stepping(), fmi2DoStep(c, 7.0, 0.1, fmi2True));
  WRONG(stepping(), fmi2DoStep(c, 5.0, 0.5, fmi2True));
  WRONG(stepping(), fmi2SetReal(c, &output, 1, &x));
  WRONG(stepping(), fmi2SetReal(c, &start, 1, &x));
  WRONG(stepping(), fmi2SetReal(c, &none, 1, &x));
  WRONG(stepping(), fmi2SetReal(c, &time, 1, &x));
  WRONG(stepping(), fmi2SetReal(c, inputs, 2, NULL));
  WRONG(stepping(), fmi2GetReal(c, &none, 1, &x));
  WRONG(stepping(), fmi2GetReal(c, &valid, 1, &x));
  WRONG(stepping(), fmi2GetReal(c, NULL, 1, &x));
  WRONG(stepping(), fmi2GetBoolean(c, &output, 1, &whole));
  WRONG(stepping(), fmi2GetInteger(c, &output, 1, &whole));
  WRONG(stepping(), fmi2GetString(c, &output, 1, &text));
  WRONG(stepping(), fmi2SetInteger(c, inputs, 1, &whole));
  WRONG(stepping(), fmi2SetBoolean(c, &valid, 1, &whole));
  WRONG(stepping(), fmi2SetString(c, inputs, 1, &text));
  WRONG(stepping(), fmi2CancelStep(c));
  WRONG(stepping(), fmi2GetDirectionalDerivative(c, &output, 1, inputs, 1, many, &x));
  WRONG(stepping(), fmi2SetRealInputDerivatives(c, inputs, 1, &whole, many));
  WRONG(stepping(), fmi2GetRealOutputDerivatives(c, &output, 1, &whole, many));
  WRONG(stepping(), fmi2GetFMUstate(c, NULL));
  WRONG(terminated(), fmi2DoStep(c, 5.0, 0.1, fmi2True));
  WRONG(terminated(), fmi2SetReal(c, inputs, 2, many));
  WRONG(terminated(), fmi2Terminate(c));
  WRONG(terminated(), fmi2ExitInitializationMode(c));
  {
    fmi2Component c = terminated();
    CLAIM(fmi2GetReal(c, &output, 1, &x) == fmi2OK);
    CLAIM(fmi2GetRealStatus(c, fmi2LastSuccessfulTime, &x) == fmi2OK && x == 5.0);
    CLAIM(fmi2GetBooleanStatus(c, fmi2Terminated, &whole) == fmi2OK && whole == fmi2False);
    CLAIM(fmi2GetStatus(c, fmi2DoStepStatus, &status) == fmi2Discard);
    fmi2FreeInstance(c);
  }
  CLAIM(fmi2DoStep(NULL, 0.0, 0.1, fmi2True) == fmi2Error);
  fmi2FreeInstance(NULL);
}

static void refused_instances(void) {
  const int before = messages;
  CLAIM(fmi2Instantiate("ship", fmi2ModelExchange, FMU_TOKEN, "", &callbacks, 0, 0) == NULL);
  CLAIM(fmi2Instantiate("ship", fmi2CoSimulation, "{another}", "", &callbacks, 0, 0) == NULL);
  CLAIM(fmi2Instantiate("", fmi2CoSimulation, FMU_TOKEN, "", &callbacks, 0, 0) == NULL);
  CLAIM(fmi2Instantiate("ship", fmi2CoSimulation, NULL, "", NULL, 0, 0) == NULL);
  CLAIM(messages == before + 3);
}

static void values(void) {
  fmi2Component c = initialized(0.5);
  double bad = (double)NAN, out[OUTPUTS], before[OUTPUTS], high = fmu_upper[0] * 2 + 1;
  run(c, 0, 3, before);
  CLAIM(fmi2SetReal(c, inputs, 1, &bad) == fmi2Discard);
  CLAIM(fmi2SetReal(c, coefficient, 1, &bad) == fmi2Discard);
  CLAIM(fmi2GetReal(c, outputs, OUTPUTS, out) == fmi2OK);
  CLAIM(memcmp(out, before, sizeof out) == 0);
  CLAIM(fmi2SetReal(c, coefficient, 1, &high) == (fmu_upper[0] < 1e300 ? fmi2Warning : fmi2OK));
  CLAIM(fmi2GetReal(c, coefficient, 1, out) == fmi2OK && out[0] == high);
  CLAIM(fmi2SetDebugLogging(c, fmi2False, 0, NULL) == fmi2OK);
  CLAIM(fmi2Terminate(c) == fmi2OK);
  fmi2FreeInstance(c);
  CLAIM(strcmp(fmi2GetVersion(), "2.0") == 0);
  CLAIM(strcmp(fmi2GetTypesPlatform(), "default") == 0);
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
