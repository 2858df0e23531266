/* What an instance of a ship calculates: her motion, her forces, what her instruments log. */
static void fmu_model(FmuCore *c) {
  if (!c->model_stale) return;
  SHIP(init)(&c->model, c->set + FMU_INPUTS + 6);
  c->model_stale = 0;
}

/* Inputs of the ship's model: the actuators as they act, the air, the water, and the time since the start. */
static void fmu_inputs(const FmuCore *c, double *inputs) {
  memcpy(inputs, c->acting, FMU_ACTUATORS * sizeof(double));
  memcpy(inputs + FMU_ACTUATORS, c->set + FMU_ACTUATORS, (FMU_INPUTS - FMU_ACTUATORS) * sizeof(double));
#if FMU_TIMED
  inputs[FMU_INPUTS] = c->time - c->start;
#endif
}

/* Before the first step the state follows from initial values, inputs and coefficients; its memory is settled. */
static void fmu_settle(FmuCore *c) {
  double inputs[FMU_INPUTS + 1];
  fmu_model(c);
  if (!c->state_stale) return;
  memcpy(c->acting, c->set, FMU_ACTUATORS * sizeof(double));
  fmu_inputs(c, inputs);
  FMU_SETTLE(&c->model, c->set + FMU_INPUTS, inputs, c->state);
  c->state_stale = 0;
  fmu_stale(c);
}

#if FMU_REMEMBERS
/* Puts the beginning of a step at the end of the history; 0 where there is no memory for it. */
static int fmu_remember(FmuInstance *x, double t) {
  const FmuCore *c = &x->core;
  FmuHeld *last;
  if (x->held == x->room) { /* first let go of what is older than any delay */
    double longest = 0.0;
    size_t drop = 0;
#if FMU_DELAYED
    longest = fmax(c->set[FMU_DELAY], fmu_upper[FMU_DELAY - FMU_INPUTS - 6]);
#endif
#if FMU_LOGS_LATE
    longest = fmax(longest, fmax(c->set[FMU_LOG_DELAY], fmu_upper[FMU_LOG_DELAY - FMU_INPUTS - 6]));
#endif
    while (drop + 1 < x->held && x->history[drop + 1].from <= t - longest) drop++;
    if (drop) memmove(x->history, x->history + drop, (x->held - drop) * sizeof(FmuHeld));
    x->held -= drop;
    if (2 * x->held >= x->room) {
      const size_t room = x->room > 128 ? 2 * x->room : 256;
      FmuHeld *larger = (FmuHeld *)x->allocate(room, sizeof(FmuHeld));
      if (!larger) return 0;
      if (x->held) memcpy(larger, x->history, x->held * sizeof(FmuHeld));
      if (x->history) x->release(x->history);
      x->history = larger;
      x->room = room;
    }
  }
  last = x->history + x->held++;
  memset(last, 0, sizeof *last);
  last->from = t;
  memcpy(last->actuators, c->set, FMU_ACTUATORS * sizeof(double));
  last->velocity[0] = c->state[3] * cos(c->state[2]) - c->state[4] * sin(c->state[2]);
  last->velocity[1] = c->state[3] * sin(c->state[2]) + c->state[4] * cos(c->state[2]);
  return 1;
}

/* Number of entries of the history that begin at `t` or before. */
static size_t fmu_entries_until(const FmuInstance *x, double t) {
  size_t i = x->held;
  while (i > 0 && x->history[i - 1].from > t) i--;
  return i;
}
#endif

/* The columns as the instruments log them. */
static void fmu_columns(FmuInstance *x) {
  FmuCore *c = &x->core;
#if FMU_LOGS_LATE
  /* u and v are those of a velocity over ground of some time ago, straight between steps, turned by the heading */
  const double past = c->time - c->set[FMU_LOG_DELAY], sine = sin(c->state[2]), cosine = cos(c->state[2]);
  const size_t before = fmu_entries_until(x, past);
  if (x->held && c->set[FMU_LOG_DELAY] > 0.0) {
    const FmuHeld *first = x->history + (before ? before - 1 : 0);
    const double now[2] = {c->state[3] * cosine - c->state[4] * sine, c->state[3] * sine + c->state[4] * cosine};
    const double *next = before == x->held ? now : first[1].velocity;
    const double end = before == x->held ? c->time : first[before ? 1 : 0].from;
    const double share = before && end > first->from ? (past - first->from) / (end - first->from) : 0.0;
    const double north = before ? first->velocity[0] + share * (next[0] - first->velocity[0]) : first->velocity[0];
    const double east = before ? first->velocity[1] + share * (next[1] - first->velocity[1]) : first->velocity[1];
    double late[FMU_STATES];
    memcpy(late, c->state, sizeof late);
    late[3] = north * cosine + east * sine;
    late[4] = east * cosine - north * sine;
    SHIP(columns)(&c->model, late, c->columns);
    return;
  }
#endif
  SHIP(columns)(&c->model, c->state, c->columns);
}

static double fmu_output(FmuInstance *x, size_t k) {
  FmuCore *c = &x->core;
  double inputs[FMU_INPUTS + 1];
  switch (k) {
    case FMU_POSITION + 0: return c->state[0];
    case FMU_POSITION + 1: return c->state[1];
    case FMU_POSITION + 5: return c->state[2];
    case FMU_VELOCITY + 0: return c->state[3];
    case FMU_VELOCITY + 1: return c->state[4];
    case FMU_VELOCITY + 5: return c->state[5];
    case FMU_POSITION + 3: return FMU_ROLL < 0 ? 0.0 : c->state[FMU_ROLL < 0 ? 0 : FMU_ROLL];
    case FMU_VELOCITY + 3: return FMU_ROLL_RATE < 0 ? 0.0 : c->state[FMU_ROLL_RATE < 0 ? 0 : FMU_ROLL_RATE];
    default: break;
  }
  if (k < FMU_LOGGED) return 0.0;
  fmu_model(c);
  if (k < FMU_FORCE) {
    if (c->columns_stale) fmu_columns(x);
    c->columns_stale = 0;
    return c->columns[k - FMU_LOGGED];
  }
  if (k < FMU_MEMORY) {
    if (c->forces_stale) {
      fmu_inputs(c, inputs);
      SHIP(forces)(&c->model, c->state, inputs, c->forces);
    }
    c->forces_stale = 0;
    return c->forces[k - FMU_FORCE];
  }
  if (k < FMU_EXTRAPOLATION) return c->state[6 + (k - FMU_MEMORY)];
  if (c->extrapolation_stale) {
    fmu_inputs(c, inputs);
    c->extrapolation = SHIP(extrapolation)(&c->model, c->state, inputs);
  }
  c->extrapolation_stale = 0;
  return c->extrapolation;
}

#if FMU_DELAYED
/* The means of the actuators over the step of h [s] from t, both `delay` ago; before the first entry they were as in
   it. */
static void fmu_act_late(FmuInstance *x, double t, double h) {
  FmuCore *c = &x->core;
  const double begin = t - c->set[FMU_DELAY], end = begin + h;
  const size_t before = fmu_entries_until(x, begin), first = before ? before - 1 : 0;
  double sum[FMU_ACTUATORS + 1] = {0.0};
  size_t i, j;
  for (i = first; i < x->held; i++) {
    const double from = i == first || x->history[i].from < begin ? begin : x->history[i].from;
    const double to = i + 1 == x->held || x->history[i + 1].from > end ? end : x->history[i + 1].from;
    if (to <= from) continue;
    for (j = 0; j < FMU_ACTUATORS; j++) sum[j] += (to - from) * x->history[i].actuators[j];
  }
  for (j = 0; j < FMU_ACTUATORS; j++) c->acting[j] = sum[j] / h;
}
#endif

static FmuResult fmu_step(FmuInstance *x, const char *function, double t, double h) {
  FmuCore *c = &x->core;
  double inputs[FMU_INPUTS + 1];
  char why[160];
  if (fmu_step_possible(x, function, t, h) != FMU_OK) return FMU_ERROR;
  fmu_model(c);
  c->time = t;
#if FMU_REMEMBERS
  if (!fmu_remember(x, t)) return fmu_error(x, function, "out of memory");
#endif
#if FMU_DELAYED
  fmu_act_late(x, t, h);
#endif
  fmu_inputs(c, inputs);
  if (SHIP(step)(&c->model, c->state, inputs, h) != 0) {
    snprintf(why, sizeof why, "the motion diverges after t = %g s; check coefficients and inputs", t);
    return fmu_error(x, function, why);
  }
  c->time = t + h;
  fmu_stale(c);
  return FMU_OK;
}
