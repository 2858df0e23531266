/* Time of one step of an FMI 2.0 FMU with its inputs set and its outputs read, by its shared library as importers use
   it. Arguments: library, GUID, number of inputs, first and number of outputs. Prints the least time of a batch [us]. */
#include <dlfcn.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "fmi2Functions.h"

enum { BATCH = 500, BATCHES = 400 };

static double now(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return 1e6 * (double)t.tv_sec + 1e-3 * (double)t.tv_nsec;
}

static void logger(fmi2ComponentEnvironment e, fmi2String n, fmi2Status s, fmi2String c, fmi2String m, ...) {
  (void)e, (void)n, (void)s, (void)c;
  fprintf(stderr, "%s\n", m);
}

int main(int argc, char **argv) {
  const fmi2CallbackFunctions callbacks = {logger, calloc, free, NULL, NULL};
  void *library = argc == 6 ? dlopen(argv[1], RTLD_NOW) : NULL;
  const unsigned inputs = argc == 6 ? (unsigned)atoi(argv[3]) : 0, outputs = argc == 6 ? (unsigned)atoi(argv[5]) : 0;
  fmi2ValueReference in[16], out[64];
  double u[16] = {0.0}, y[64], least = HUGE_VAL, t = 0.0;
  unsigned i;
  int batch, k;
  fmi2Component c;
  if (!library || inputs > 16 || outputs > 64) return 2;
#define LOAD(name) name##TYPE *const f_##name = (name##TYPE *)dlsym(library, #name)
  LOAD(fmi2Instantiate);
  LOAD(fmi2SetupExperiment);
  LOAD(fmi2EnterInitializationMode);
  LOAD(fmi2ExitInitializationMode);
  LOAD(fmi2SetReal);
  LOAD(fmi2DoStep);
  LOAD(fmi2GetReal);
  for (i = 0; i < inputs; i++) in[i] = 1 + i;
  for (i = 0; i < outputs; i++) out[i] = (unsigned)atoi(argv[4]) + i;
  c = f_fmi2Instantiate("ship", fmi2CoSimulation, argv[2], "", &callbacks, 0, 0);
  if (!c || f_fmi2SetupExperiment(c, 0, 0.0, 0.0, 0, 0.0) || f_fmi2EnterInitializationMode(c)) return 3;
  if (f_fmi2ExitInitializationMode(c)) return 3;
  for (batch = 0; batch < BATCHES; batch++) {
    const double begin = now();
    double taken;
    for (k = 0; k < BATCH; k++, t += 0.1) {
      u[0] = 8.0 + 0.001 * k;
      u[1] = 0.3 * (k % 100) / 100.0;
      u[2] = 1.0 + 0.001 * k;
      u[3] = 0.5;
      if (f_fmi2SetReal(c, in, inputs, u) || f_fmi2DoStep(c, t, 0.1, 1) || f_fmi2GetReal(c, out, outputs, y)) return 4;
    }
    taken = (now() - begin) / BATCH;
    if (taken < least) least = taken;
  }
  printf("%.4f\n", least);
  return 0;
}
