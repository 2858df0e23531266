/* FMI 3.0 for Co-Simulation (https://fmi-standard.org) of the instance in fmu-instance.c. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"
#include "fmu-instance.h"

typedef char fmu_references_fit[sizeof(fmi3ValueReference) == sizeof(unsigned) ? 1 : -1];

#define WRITABLE (FMU_INSTANTIATED | FMU_INITIALIZATION | FMU_STEPPING)

/* The instance `x` of a function that may be called in `phases`. */
#define INSTANCE(phases)                                       \
  FmuInstance *x = (FmuInstance *)instance;                    \
  if (!x || fmu_allowed(x, __func__, phases) != FMU_OK) return fmi3Error

static void say3(FmuInstance *x, FmuResult status, const char *category, const char *message) {
  const fmi3LogMessageCallback logger = (fmi3LogMessageCallback)x->logger;
  logger(x->environment, (fmi3Status)status, category, message);
}

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean loggingOn, size_t nCategories,
                               const fmi3String categories[]) {
  INSTANCE(FMU_ANY);
  if (nCategories && !categories) return (fmi3Status)fmu_error(x, __func__, "an array is missing");
  x->debug = loggingOn;
  return fmi3OK;
}

static void *refused(const char *function, const char *why, fmi3InstanceEnvironment environment,
                     fmi3LogMessageCallback logMessage) {
  char text[160];
  snprintf(text, sizeof text, "%s: %s", function, why);
  if (logMessage) logMessage(environment, fmi3Error, "logStatusError", text);
  return NULL;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String instanceName, fmi3String instantiationToken,
                                          fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
                                          fmi3InstanceEnvironment instanceEnvironment,
                                          fmi3LogMessageCallback logMessage) {
  (void)instanceName, (void)instantiationToken, (void)resourcePath, (void)visible, (void)loggingOn;
  return refused(__func__, "this is an FMU for co-simulation only", instanceEnvironment, logMessage);
}

fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath, fmi3Boolean visible,
    fmi3Boolean loggingOn, fmi3InstanceEnvironment instanceEnvironment, fmi3LogMessageCallback logMessage,
    fmi3ClockUpdateCallback clockUpdate, fmi3LockPreemptionCallback lockPreemption,
    fmi3UnlockPreemptionCallback unlockPreemption) {
  (void)instanceName, (void)instantiationToken, (void)resourcePath, (void)visible, (void)loggingOn;
  (void)clockUpdate, (void)lockPreemption, (void)unlockPreemption;
  return refused(__func__, "this is an FMU for co-simulation only", instanceEnvironment, logMessage);
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String instanceName, fmi3String instantiationToken,
                                         fmi3String resourcePath, fmi3Boolean visible, fmi3Boolean loggingOn,
                                         fmi3Boolean eventModeUsed, fmi3Boolean earlyReturnAllowed,
                                         const fmi3ValueReference requiredIntermediateVariables[],
                                         size_t nRequiredIntermediateVariables,
                                         fmi3InstanceEnvironment instanceEnvironment,
                                         fmi3LogMessageCallback logMessage,
                                         fmi3IntermediateUpdateCallback intermediateUpdate) {
  const char *why = NULL;
  FmuInstance *x;
  (void)resourcePath, (void)visible, (void)earlyReturnAllowed;
  (void)requiredIntermediateVariables, (void)intermediateUpdate;
  if (!instanceName || !*instanceName) why = "the instance has no name";
  else if (!instantiationToken || strcmp(instantiationToken, FMU_TOKEN) != 0) why = "the token is not that of this FMU";
  else if (eventModeUsed) why = "this FMU has no event mode";
  else if (nRequiredIntermediateVariables) why = "this FMU has no intermediate updates";
  if (why) return refused(__func__, why, instanceEnvironment, logMessage);
  x = fmu_new(instanceName, calloc, free);
  if (!x) return NULL;
  if (logMessage) {
    x->environment = instanceEnvironment;
    x->logger = (void (*)(void))logMessage;
    x->say = say3;
  }
  x->debug = loggingOn;
  return x;
}

void fmi3FreeInstance(fmi3Instance instance) {
  if (instance) fmu_free((FmuInstance *)instance);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean toleranceDefined, fmi3Float64 tolerance,
                                       fmi3Float64 startTime, fmi3Boolean stopTimeDefined, fmi3Float64 stopTime) {
  INSTANCE(FMU_INSTANTIATED);
  (void)toleranceDefined; /* the step of the integration is fixed */
  (void)tolerance;
  if (!isfinite(startTime) || (stopTimeDefined && !(stopTime >= startTime))) {
    return (fmi3Status)fmu_error(x, __func__, "start and stop time make no sense");
  }
  x->core.start = x->core.time = startTime;
  x->core.limited = stopTimeDefined;
  x->core.stop = stopTimeDefined ? stopTime : 0.0;
  x->core.configured = 1;
  x->core.phase = FMU_INITIALIZATION;
  return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) {
  INSTANCE(FMU_INITIALIZATION);
  fmu_settle(&x->core);
  x->core.phase = FMU_STEPPING;
  return fmi3OK;
}

fmi3Status fmi3Terminate(fmi3Instance instance) {
  INSTANCE(FMU_STEPPING);
  x->core.phase = FMU_TERMINATED;
  return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance instance) {
  INSTANCE(FMU_ANY);
  fmu_reset(x);
  return fmi3OK;
}

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                          fmi3Float64 values[], size_t nValues) {
  INSTANCE(FMU_ANY);
  if (nValues != nValueReferences) return (fmi3Status)fmu_error(x, __func__, "all variables are scalars");
  return (fmi3Status)fmu_get(x, __func__, valueReferences, nValueReferences, values);
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                          const fmi3Float64 values[], size_t nValues) {
  INSTANCE(WRITABLE);
  if (nValues != nValueReferences) return (fmi3Status)fmu_error(x, __func__, "all variables are scalars");
  return (fmi3Status)fmu_set(x, __func__, valueReferences, nValueReferences, values);
}

fmi3Status fmi3GetBoolean(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                          fmi3Boolean values[], size_t nValues) {
  size_t i;
  INSTANCE(FMU_ANY);
  if (nValues != nValueReferences) return (fmi3Status)fmu_error(x, __func__, "all variables are scalars");
  if (nValues && (!valueReferences || !values)) return (fmi3Status)fmu_error(x, __func__, "an array is missing");
  for (i = 0; i < nValueReferences; i++) {
    if (valueReferences[i] != FMU_VALID) {
      return (fmi3Status)fmu_error(x, __func__, "there is no such Boolean variable");
    }
    values[i] = fmu_valid(x) != 0;
  }
  return fmi3OK;
}

/* There are no variables of the other types, and no Boolean that can be set: a call that names one is an error. */
#define NOTHING(phases)                                              \
  INSTANCE(phases);                                                  \
  (void)valueReferences;                                             \
  (void)values;                                                      \
  return nValueReferences ? (fmi3Status)fmu_error(x, __func__, "there is no such variable") : fmi3OK

#define GET_NOTHING(name)                                                                                        \
  fmi3Status fmi3Get##name(fmi3Instance instance, const fmi3ValueReference valueReferences[],                    \
                           size_t nValueReferences, fmi3##name values[], size_t nValues) {                       \
    (void)nValues;                                                                                               \
    NOTHING(FMU_ANY);                                                                                            \
  }
#define SET_NOTHING(name)                                                                                        \
  fmi3Status fmi3Set##name(fmi3Instance instance, const fmi3ValueReference valueReferences[],                    \
                           size_t nValueReferences, const fmi3##name values[], size_t nValues) {                 \
    (void)nValues;                                                                                               \
    NOTHING(WRITABLE);                                                                                           \
  }

GET_NOTHING(Float32)
GET_NOTHING(Int8)
GET_NOTHING(UInt8)
GET_NOTHING(Int16)
GET_NOTHING(UInt16)
GET_NOTHING(Int32)
GET_NOTHING(UInt32)
GET_NOTHING(Int64)
GET_NOTHING(UInt64)
GET_NOTHING(String)
SET_NOTHING(Float32)
SET_NOTHING(Int8)
SET_NOTHING(UInt8)
SET_NOTHING(Int16)
SET_NOTHING(UInt16)
SET_NOTHING(Int32)
SET_NOTHING(UInt32)
SET_NOTHING(Int64)
SET_NOTHING(UInt64)
SET_NOTHING(Boolean)
SET_NOTHING(String)

fmi3Status fmi3GetBinary(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                         size_t valueSizes[], fmi3Binary values[], size_t nValues) {
  (void)valueSizes, (void)nValues;
  NOTHING(FMU_ANY);
}

fmi3Status fmi3SetBinary(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                         const size_t valueSizes[], const fmi3Binary values[], size_t nValues) {
  (void)valueSizes, (void)nValues;
  NOTHING(WRITABLE);
}

fmi3Status fmi3GetClock(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                        fmi3Clock values[]) {
  NOTHING(FMU_ANY);
}

fmi3Status fmi3SetClock(fmi3Instance instance, const fmi3ValueReference valueReferences[], size_t nValueReferences,
                        const fmi3Clock values[]) {
  NOTHING(WRITABLE);
}

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *FMUState) {
  INSTANCE(FMU_ANY);
  return (fmi3Status)fmu_save(x, __func__, FMUState);
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState FMUState) {
  INSTANCE(FMU_ANY);
  return (fmi3Status)fmu_restore(x, __func__, FMUState);
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *FMUState) {
  INSTANCE(FMU_ANY);
  return (fmi3Status)fmu_free_state(x, __func__, FMUState);
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState FMUState, size_t *size) {
  INSTANCE(FMU_ANY);
  return (fmi3Status)fmu_state_size(x, __func__, FMUState, size);
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState FMUState, fmi3Byte serializedState[],
                                 size_t size) {
  INSTANCE(FMU_ANY);
  return (fmi3Status)fmu_serialize(x, __func__, FMUState, serializedState, size);
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte serializedState[], size_t size,
                                   fmi3FMUState *FMUState) {
  INSTANCE(FMU_ANY);
  return (fmi3Status)fmu_deserialize(x, __func__, serializedState, size, FMUState);
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 currentCommunicationPoint, fmi3Float64 communicationStepSize,
                      fmi3Boolean noSetFMUStatePriorToCurrentPoint, fmi3Boolean *eventHandlingNeeded,
                      fmi3Boolean *terminateSimulation, fmi3Boolean *earlyReturn, fmi3Float64 *lastSuccessfulTime) {
  FmuResult result;
  INSTANCE(FMU_STEPPING);
  (void)noSetFMUStatePriorToCurrentPoint;
  if (!eventHandlingNeeded || !terminateSimulation || !earlyReturn || !lastSuccessfulTime) {
    return (fmi3Status)fmu_error(x, __func__, "an argument is missing");
  }
  result = fmu_step(x, __func__, currentCommunicationPoint, communicationStepSize);
  *eventHandlingNeeded = *terminateSimulation = *earlyReturn = fmi3False;
  *lastSuccessfulTime = x->core.time;
  return (fmi3Status)result;
}

/* Functions that this FMU does not have, or that may never be called as it has no event mode, no clocks, no structural
   parameters and no derivatives. */

fmi3Status fmi3EnterEventMode(fmi3Instance instance) {
  INSTANCE(FMU_ANY);
  return (fmi3Status)fmu_error(x, __func__, "this FMU has no event mode");
}

fmi3Status fmi3EnterStepMode(fmi3Instance instance) {
  INSTANCE(FMU_ANY);
  return (fmi3Status)fmu_error(x, __func__, "this FMU has no event mode");
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *discreteStatesNeedUpdate,
                                    fmi3Boolean *terminateSimulation, fmi3Boolean* nominalsOfContinuousStatesChanged,
                                    fmi3Boolean *valuesOfContinuousStatesChanged, fmi3Boolean* nextEventTimeDefined,
                                    fmi3Float64 *nextEventTime) {
  INSTANCE(FMU_ANY);
  (void)discreteStatesNeedUpdate, (void)terminateSimulation, (void)nominalsOfContinuousStatesChanged,
      (void)valuesOfContinuousStatesChanged, (void)nextEventTimeDefined, (void)nextEventTime;
  return (fmi3Status)fmu_error(x, __func__, "this FMU has no event mode");
}

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance instance) {
  INSTANCE(FMU_ANY);
  return (fmi3Status)fmu_error(x, __func__, "this FMU has no event mode");
}

fmi3Status fmi3EnterConfigurationMode(fmi3Instance instance) {
  INSTANCE(FMU_ANY);
  return (fmi3Status)fmu_error(x, __func__, "this FMU has no structural parameters");
}

fmi3Status fmi3ExitConfigurationMode(fmi3Instance instance) {
  INSTANCE(FMU_ANY);
  return (fmi3Status)fmu_error(x, __func__, "this FMU has no structural parameters");
}

fmi3Status fmi3GetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                  size_t nValueReferences, fmi3Float64 intervals[],
                                  fmi3IntervalQualifier qualifiers[]) {
  INSTANCE(FMU_ANY);
  (void)valueReferences, (void)nValueReferences, (void)intervals, (void)qualifiers;
  return (fmi3Status)fmu_error(x, __func__, "this FMU has no clocks");
}

fmi3Status fmi3GetIntervalFraction(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                   size_t nValueReferences, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
                                   fmi3IntervalQualifier qualifiers[]) {
  INSTANCE(FMU_ANY);
  (void)valueReferences, (void)nValueReferences, (void)counters, (void)resolutions, (void)qualifiers;
  return (fmi3Status)fmu_error(x, __func__, "this FMU has no clocks");
}

fmi3Status fmi3GetShiftDecimal(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                               size_t nValueReferences, fmi3Float64 shifts[]) {
  INSTANCE(FMU_ANY);
  (void)valueReferences, (void)nValueReferences, (void)shifts;
  return (fmi3Status)fmu_error(x, __func__, "this FMU has no clocks");
}

fmi3Status fmi3GetShiftFraction(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                size_t nValueReferences, fmi3UInt64 counters[], fmi3UInt64 resolutions[]) {
  INSTANCE(FMU_ANY);
  (void)valueReferences, (void)nValueReferences, (void)counters, (void)resolutions;
  return (fmi3Status)fmu_error(x, __func__, "this FMU has no clocks");
}

fmi3Status fmi3SetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                  size_t nValueReferences, const fmi3Float64 intervals[]) {
  INSTANCE(FMU_ANY);
  (void)valueReferences, (void)nValueReferences, (void)intervals;
  return (fmi3Status)fmu_error(x, __func__, "this FMU has no clocks");
}

fmi3Status fmi3SetIntervalFraction(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                   size_t nValueReferences, const fmi3UInt64 counters[],
                                   const fmi3UInt64 resolutions[]) {
  INSTANCE(FMU_ANY);
  (void)valueReferences, (void)nValueReferences, (void)counters, (void)resolutions;
  return (fmi3Status)fmu_error(x, __func__, "this FMU has no clocks");
}

fmi3Status fmi3SetShiftDecimal(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                               size_t nValueReferences, const fmi3Float64 shifts[]) {
  INSTANCE(FMU_ANY);
  (void)valueReferences, (void)nValueReferences, (void)shifts;
  return (fmi3Status)fmu_error(x, __func__, "this FMU has no clocks");
}

fmi3Status fmi3SetShiftFraction(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                size_t nValueReferences, const fmi3UInt64 counters[],
                                const fmi3UInt64 resolutions[]) {
  INSTANCE(FMU_ANY);
  (void)valueReferences, (void)nValueReferences, (void)counters, (void)resolutions;
  return (fmi3Status)fmu_error(x, __func__, "this FMU has no clocks");
}

fmi3Status fmi3ActivateModelPartition(fmi3Instance instance, fmi3ValueReference clockReference,
                                      fmi3Float64 activationTime) {
  INSTANCE(FMU_ANY);
  (void)clockReference, (void)activationTime;
  return (fmi3Status)fmu_error(x, __func__, "this FMU has no clocks");
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t nUnknowns,
                                        const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[],
                                        size_t nSeed, fmi3Float64 sensitivity[], size_t nSensitivity) {
  INSTANCE(FMU_ANY);
  (void)unknowns, (void)nUnknowns, (void)knowns, (void)nKnowns, (void)seed, (void)nSeed, (void)sensitivity,
      (void)nSensitivity;
  return (fmi3Status)fmu_error(x, __func__, "this FMU does not provide derivatives");
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t nUnknowns,
                                    const fmi3ValueReference knowns[], size_t nKnowns, const fmi3Float64 seed[],
                                    size_t nSeed, fmi3Float64 sensitivity[], size_t nSensitivity) {
  INSTANCE(FMU_ANY);
  (void)unknowns, (void)nUnknowns, (void)knowns, (void)nKnowns, (void)seed, (void)nSeed, (void)sensitivity,
      (void)nSensitivity;
  return (fmi3Status)fmu_error(x, __func__, "this FMU does not provide derivatives");
}

fmi3Status fmi3GetOutputDerivatives(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                    size_t nValueReferences, const fmi3Int32 orders[], fmi3Float64 values[],
                                    size_t nValues) {
  INSTANCE(FMU_ANY);
  (void)valueReferences, (void)nValueReferences, (void)orders, (void)values, (void)nValues;
  return (fmi3Status)fmu_error(x, __func__, "this FMU does not provide derivatives");
}

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance instance, fmi3ValueReference valueReference,
                                               size_t *nDependencies) {
  INSTANCE(FMU_ANY);
  (void)valueReference, (void)nDependencies;
  return (fmi3Status)fmu_error(x, __func__, "this FMU does not tell dependencies");
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance instance, fmi3ValueReference dependent,
                                       size_t elementIndicesOfDependent[], fmi3ValueReference independents[],
                                       size_t elementIndicesOfIndependents[], fmi3DependencyKind dependencyKinds[],
                                       size_t nDependencies) {
  INSTANCE(FMU_ANY);
  (void)dependent, (void)elementIndicesOfDependent, (void)independents, (void)elementIndicesOfIndependents,
      (void)dependencyKinds, (void)nDependencies;
  return (fmi3Status)fmu_error(x, __func__, "this FMU does not tell dependencies");
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance) {
  INSTANCE(FMU_ANY);
  return (fmi3Status)fmu_error(x, __func__, "this is an FMU for co-simulation only");
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance, fmi3Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi3Boolean *enterEventMode, fmi3Boolean* terminateSimulation) {
  INSTANCE(FMU_ANY);
  (void)noSetFMUStatePriorToCurrentPoint, (void)enterEventMode, (void)terminateSimulation;
  return (fmi3Status)fmu_error(x, __func__, "this is an FMU for co-simulation only");
}

fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time) {
  INSTANCE(FMU_ANY);
  (void)time;
  return (fmi3Status)fmu_error(x, __func__, "this is an FMU for co-simulation only");
}

fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 continuousStates[],
                                   size_t nContinuousStates) {
  INSTANCE(FMU_ANY);
  (void)continuousStates, (void)nContinuousStates;
  return (fmi3Status)fmu_error(x, __func__, "this is an FMU for co-simulation only");
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 derivatives[],
                                             size_t nContinuousStates) {
  INSTANCE(FMU_ANY);
  (void)derivatives, (void)nContinuousStates;
  return (fmi3Status)fmu_error(x, __func__, "this is an FMU for co-simulation only");
}

fmi3Status fmi3GetEventIndicators(fmi3Instance instance, fmi3Float64 eventIndicators[], size_t nEventIndicators) {
  INSTANCE(FMU_ANY);
  (void)eventIndicators, (void)nEventIndicators;
  return (fmi3Status)fmu_error(x, __func__, "this is an FMU for co-simulation only");
}

fmi3Status fmi3GetContinuousStates(fmi3Instance instance, fmi3Float64 continuousStates[], size_t nContinuousStates) {
  INSTANCE(FMU_ANY);
  (void)continuousStates, (void)nContinuousStates;
  return (fmi3Status)fmu_error(x, __func__, "this is an FMU for co-simulation only");
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 nominals[],
                                             size_t nContinuousStates) {
  INSTANCE(FMU_ANY);
  (void)nominals, (void)nContinuousStates;
  return (fmi3Status)fmu_error(x, __func__, "this is an FMU for co-simulation only");
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *nEventIndicators) {
  INSTANCE(FMU_ANY);
  (void)nEventIndicators;
  return (fmi3Status)fmu_error(x, __func__, "this is an FMU for co-simulation only");
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *nContinuousStates) {
  INSTANCE(FMU_ANY);
  (void)nContinuousStates;
  return (fmi3Status)fmu_error(x, __func__, "this is an FMU for co-simulation only");
}
