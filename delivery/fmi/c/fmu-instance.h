/* One instance of the ship, or of a filter of her (FMU_TRACKS), in a co-simulation, as both versions of FMI need it:
   variables, phases, stepping, saved states. It knows nothing of FMI itself. Variables have value references in this
   order:

     0                          time
     1 .. FMU_INPUTS            inputs
     .. + 6                     initial.*: position, heading and velocities at the start; of a filter measured.*
     .. + FMU_PARAMETERS        coefficients.*; of a filter then noise.*, memory.* and horizon
     then the outputs in the order of enum FmuOutput, and last the Boolean `valid`.

   All that changes lies in an instance: there are no global variables. */
#ifndef FMU_INSTANCE_H
#define FMU_INSTANCE_H

#include <stddef.h>

#include "fmu-model.h"

#define FMU_SET (FMU_INPUTS + 6 + FMU_PARAMETERS)
#define FMU_REMEMBERED (FMU_STATES - 6)

#if FMU_TRACKS
enum FmuOutput {
  FMU_ESTIMATE = 0,                               /* logged x, y, psi, u, v, r and random states at the time */
  FMU_STD = FMU_ESTIMATES,                        /* their standard deviations */
  FMU_NIS = 2 * FMU_ESTIMATES,
  FMU_COMPARED,
  FMU_EXPECTED,                                   /* x, y, psi, u, v, r that will be logged after the horizon */
  FMU_EXPECTED_STD = FMU_EXPECTED + 6,
  FMU_EXTRAPOLATION = FMU_EXPECTED_STD + 6,
  FMU_OUTPUTS
};
#else
enum FmuOutput {
  FMU_POSITION = 0,                               /* north, east, down, roll, pitch, yaw */
  FMU_VELOCITY = 6,                               /* surge, sway, heave, roll, pitch, yaw */
  FMU_LOGGED = 12,                                /* x, y, psi, u, v, r */
  FMU_FORCE = 18,                                 /* X, Y, N of each role */
  FMU_MEMORY = FMU_FORCE + 3 * FMU_ROLES,         /* what the ship remembers */
  FMU_EXTRAPOLATION = FMU_MEMORY + FMU_REMEMBERED,
  FMU_OUTPUTS
};
#endif

#define FMU_FIRST_OUTPUT (1 + FMU_SET)
#define FMU_VALID (FMU_FIRST_OUTPUT + FMU_OUTPUTS)

/* The numbers are those of fmi2Status and fmi3Status. */
typedef enum { FMU_OK = 0, FMU_WARNING = 1, FMU_DISCARD = 2, FMU_ERROR = 3 } FmuResult;

/* Where an instance is in its life; one bit each, so that a set of phases is their sum. */
typedef enum {
  FMU_INSTANTIATED = 1,
  FMU_INITIALIZATION = 2,
  FMU_STEPPING = 4,
  FMU_TERMINATED = 8,
  FMU_FAILED = 16
} FmuPhase;

#define FMU_ANY (FMU_INSTANTIATED | FMU_INITIALIZATION | FMU_STEPPING | FMU_TERMINATED | FMU_FAILED)

/* What a saved state holds: no pointers, so that copying its bytes copies it. */
typedef struct {
  int phase;           /* one of FmuPhase */
  int configured;      /* whether the experiment was set up */
  int limited;         /* whether there is a stop time */
  int model_stale;     /* coefficients were written since the coefficient stage ran */
  int state_stale;     /* what `state` follows from was written since; only before the first step */
  int forces_stale, columns_stale, extrapolation_stale;
  double start, stop, time;
  double set[FMU_SET]; /* inputs, initial values or what is measured, parameters */
#if FMU_TRACKS
  SHIP(filter) filter, now; /* after the last sample, and at the time */
  double outputs[FMU_OUTPUTS];
#else
  double acting[FMU_INPUTS];
  double state[FMU_STATES];
  double forces[3 * FMU_ROLES];
  double columns[6];
  double extrapolation;
  SHIP(model) model;
#endif
} FmuCore;

#define FMU_REMEMBERS (FMU_DELAYED || FMU_LOGS_LATE)

/* The beginning of a step: actuators from then on, until the next entry; velocity over ground, north and east. */
typedef struct {
  double from;
  double actuators[FMU_ACTUATORS + 1];
  double velocity[2];
} FmuHeld;

typedef struct FmuInstance FmuInstance;

struct FmuInstance {
  FmuCore core;
  FmuHeld *history; /* of a ship that acts or logs late; oldest first */
  size_t held, room;
  void *(*allocate)(size_t count, size_t size);
  void (*release)(void *memory);
  void (*say)(FmuInstance *instance, FmuResult status, const char *category, const char *message);
  char *name;
  int debug;         /* whether messages that are no errors are wanted */
  void *environment; /* of the importer */
  void (*logger)(void);
};

/* A saved state: a copy of the core and of the history behind it. */
typedef struct {
  size_t bytes; /* of `data` */
  unsigned char data[1];
} FmuState;

#endif
