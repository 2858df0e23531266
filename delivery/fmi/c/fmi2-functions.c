/* FMI 2.0 for Co-Simulation (https://fmi-standard.org) of the instance in fmu-instance.c. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"
#include "fmu-instance.h"

typedef char fmu_references_fit[sizeof(fmi2ValueReference) == sizeof(unsigned) ? 1 : -1];

#define READABLE (FMU_INITIALIZATION | FMU_STEPPING | FMU_TERMINATED | FMU_FAILED)
#define WRITABLE (FMU_INSTANTIATED | FMU_INITIALIZATION | FMU_STEPPING)

/* The instance `x` of a function that may be called in `phases`. */
#define INSTANCE(phases)                                       \
  FmuInstance *x = (FmuInstance *)c;                           \
  if (!x || fmu_allowed(x, __func__, phases) != FMU_OK) return fmi2Error

static void say2(FmuInstance *x, FmuResult status, const char *category, const char *message) {
  const fmi2CallbackLogger logger = (fmi2CallbackLogger)x->logger;
  logger(x->environment, x->name, (fmi2Status)status, category, "%s", message);
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }

const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean loggingOn, size_t nCategories,
                               const fmi2String categories[]) {
  INSTANCE(FMU_ANY);
  if (nCategories && !categories) return (fmi2Status)fmu_error(x, __func__, "an array is missing");
  x->debug = loggingOn != fmi2False;
  return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID,
                              fmi2String fmuResourceLocation, const fmi2CallbackFunctions *functions,
                              fmi2Boolean visible, fmi2Boolean loggingOn) {
  const char *why = NULL;
  FmuInstance *x;
  (void)fmuResourceLocation;
  (void)visible;
  if (!instanceName || !*instanceName) why = "the instance has no name";
  else if (fmuType != fmi2CoSimulation) why = "this is an FMU for co-simulation only";
  else if (!fmuGUID || strcmp(fmuGUID, FMU_TOKEN) != 0) why = "the GUID is not that of this FMU";
  if (why) {
    if (functions && functions->logger) {
      functions->logger(functions->componentEnvironment, instanceName ? instanceName : "", fmi2Error, "logStatusError",
                        "fmi2Instantiate: %s", why);
    }
    return NULL;
  }
  if (functions && functions->allocateMemory && functions->freeMemory) {
    x = fmu_new(instanceName, functions->allocateMemory, functions->freeMemory);
  } else {
    x = fmu_new(instanceName, calloc, free);
  }
  if (!x) return NULL;
  if (functions && functions->logger) {
    x->environment = functions->componentEnvironment;
    x->logger = (void (*)(void))functions->logger;
    x->say = say2;
  }
  x->debug = loggingOn != fmi2False;
  return x;
}

void fmi2FreeInstance(fmi2Component c) {
  if (c) fmu_free((FmuInstance *)c);
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance, fmi2Real startTime,
                               fmi2Boolean stopTimeDefined, fmi2Real stopTime) {
  INSTANCE(FMU_INSTANTIATED);
  (void)toleranceDefined; /* the step of the integration is fixed */
  (void)tolerance;
  if (!isfinite(startTime) || (stopTimeDefined && !(stopTime >= startTime))) {
    return (fmi2Status)fmu_error(x, __func__, "start and stop time make no sense");
  }
  x->core.start = x->core.time = startTime;
  x->core.limited = stopTimeDefined != fmi2False;
  x->core.stop = stopTimeDefined ? stopTime : 0.0;
  x->core.configured = 1;
  return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
  INSTANCE(FMU_INSTANTIATED);
  if (!x->core.configured) return (fmi2Status)fmu_error(x, __func__, "fmi2SetupExperiment must be called before");
  x->core.phase = FMU_INITIALIZATION;
  return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
  INSTANCE(FMU_INITIALIZATION);
  fmu_settle(&x->core);
  x->core.phase = FMU_STEPPING;
  return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component c) {
  INSTANCE(FMU_STEPPING);
  x->core.phase = FMU_TERMINATED;
  return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c) {
  INSTANCE(FMU_ANY);
  fmu_reset(x);
  return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Real value[]) {
  INSTANCE(READABLE);
  return (fmi2Status)fmu_get(x, __func__, vr, nvr, value);
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Real value[]) {
  INSTANCE(WRITABLE);
  return (fmi2Status)fmu_set(x, __func__, vr, nvr, value);
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Boolean value[]) {
  size_t i;
  INSTANCE(READABLE);
  if (nvr && (!vr || !value)) return (fmi2Status)fmu_error(x, __func__, "an array is missing");
  for (i = 0; i < nvr; i++) {
    if (vr[i] != FMU_VALID) return (fmi2Status)fmu_error(x, __func__, "there is no such Boolean variable");
    value[i] = fmu_valid(x) ? fmi2True : fmi2False;
  }
  return fmi2OK;
}

/* There are no integers and strings, and no Boolean that can be set: a call that names one is an error. */
#define NOTHING(phases)                                              \
  INSTANCE(phases);                                                  \
  (void)vr;                                                          \
  (void)value;                                                       \
  return nvr ? (fmi2Status)fmu_error(x, __func__, "there is no such variable") : fmi2OK

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Integer value[]) {
  NOTHING(READABLE);
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2String value[]) {
  NOTHING(READABLE);
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Integer value[]) {
  NOTHING(WRITABLE);
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Boolean value[]) {
  NOTHING(WRITABLE);
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2String value[]) {
  NOTHING(WRITABLE);
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *FMUstate) {
  INSTANCE(FMU_ANY);
  return (fmi2Status)fmu_save(x, __func__, FMUstate);
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate FMUstate) {
  INSTANCE(FMU_ANY);
  return (fmi2Status)fmu_restore(x, __func__, FMUstate);
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *FMUstate) {
  INSTANCE(FMU_ANY);
  return (fmi2Status)fmu_free_state(x, __func__, FMUstate);
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate FMUstate, size_t *size) {
  INSTANCE(FMU_ANY);
  return (fmi2Status)fmu_state_size(x, __func__, FMUstate, size);
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate FMUstate, fmi2Byte serializedState[], size_t size) {
  INSTANCE(FMU_ANY);
  return (fmi2Status)fmu_serialize(x, __func__, FMUstate, serializedState, size);
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte serializedState[], size_t size,
                                   fmi2FMUstate *FMUstate) {
  INSTANCE(FMU_ANY);
  return (fmi2Status)fmu_deserialize(x, __func__, serializedState, size, FMUstate);
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference vUnknown_ref[], size_t nUnknown,
                                        const fmi2ValueReference vKnown_ref[], size_t nKnown,
                                        const fmi2Real dvKnown[], fmi2Real dvUnknown[]) {
  INSTANCE(FMU_ANY);
  (void)vUnknown_ref, (void)nUnknown, (void)vKnown_ref, (void)nKnown, (void)dvKnown, (void)dvUnknown;
  return (fmi2Status)fmu_error(x, __func__, "this FMU does not provide directional derivatives");
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                       const fmi2Integer order[], const fmi2Real value[]) {
  INSTANCE(FMU_ANY);
  (void)vr, (void)nvr, (void)order, (void)value;
  return (fmi2Status)fmu_error(x, __func__, "inputs are held over a step, so they have no derivatives");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                        const fmi2Integer order[], fmi2Real value[]) {
  INSTANCE(FMU_ANY);
  (void)vr, (void)nvr, (void)order, (void)value;
  return (fmi2Status)fmu_error(x, __func__, "this FMU does not provide derivatives of its outputs");
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real currentCommunicationPoint, fmi2Real communicationStepSize,
                      fmi2Boolean noSetFMUStatePriorToCurrentPoint) {
  INSTANCE(FMU_STEPPING);
  (void)noSetFMUStatePriorToCurrentPoint;
  return (fmi2Status)fmu_step(x, __func__, currentCommunicationPoint, communicationStepSize);
}

fmi2Status fmi2CancelStep(fmi2Component c) {
  INSTANCE(FMU_ANY);
  return (fmi2Status)fmu_error(x, __func__, "no step is in progress: steps are not asynchronous");
}

/* Steps end before fmi2DoStep returns, so that nothing is ever pending. */
fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind s, fmi2Status *value) {
  INSTANCE(FMU_STEPPING | FMU_TERMINATED | FMU_FAILED);
  (void)s, (void)value;
  fmu_report(x, FMU_DISCARD, "%s: no step is pending", __func__);
  return fmi2Discard;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind s, fmi2Real *value) {
  INSTANCE(FMU_STEPPING | FMU_TERMINATED | FMU_FAILED);
  if (s != fmi2LastSuccessfulTime || !value) return fmi2Discard;
  *value = x->core.time;
  return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind s, fmi2Integer *value) {
  INSTANCE(FMU_STEPPING | FMU_TERMINATED | FMU_FAILED);
  (void)s, (void)value;
  return fmi2Discard;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind s, fmi2Boolean *value) {
  INSTANCE(FMU_STEPPING | FMU_TERMINATED | FMU_FAILED);
  if (s != fmi2Terminated || !value) return fmi2Discard;
  *value = fmi2False;
  return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind s, fmi2String *value) {
  INSTANCE(FMU_STEPPING | FMU_TERMINATED | FMU_FAILED);
  (void)s, (void)value;
  return fmi2Discard;
}
