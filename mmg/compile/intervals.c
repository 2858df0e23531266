/* The loops over steps and blocks, and the functions that Python calls. */
static void begin_block(const Run* r, long long i, Block* b, int order) {
  for (int j = 0; j < ALL; j++) for (int l = 0; l < LANES; l++) b->p[j][l] = r->theta[j * r->groups + r->group[i + l]];
  for (int l = 0; l < LANES; l++) b->steps[l] = (double)r->count[i + l];
  for (int s = 0; s < S; s++) b->z[s] = load(r->start + s * r->lanes + i);
  if (order == 0) rates_shared(b->p, b->shared_r); else jacobian_shared(b->p, b->shared_j);
#if CURVE
  if (order == 2) hessian_shared(b->p, b->shared_h);
#endif
}
/* Inputs of step k after a part of it: those held over it, or their means and, behind these, their changes over it. */
static void read_inputs(const Run* r, long long k, long long i, double part, V* c) {
  const double* from = r->controls + k * (r->changes ? 2 * C : C) * r->lanes + i;
  for (int j = 0; j < C; j++) c[j] = load(from + j * r->lanes);
  if (r->changes) for (int j = 0; j < C; j++) c[j] += (part - 0.5) * load(from + (C + j) * r->lanes);
}
static void keep_states(const Run* r, long long k, long long i, const V* z) {
  double* to = k == r->steps - 1 ? r->end : r->interior + k * S * r->lanes;
  if (to) for (int s = 0; s < S; s++) store(to + s * r->lanes + i, z[s]);
}

static void* aligned(size_t size, void** base) {
  *base = malloc(size + sizeof(V));
  return *base ? (char*)*base + sizeof(V) - (size_t)*base % sizeof(V) : 0;
}

EXPORT int values(const Run* r) {
  void* base;
  Block* b = aligned(sizeof *b, &base);
  if (!b) return 1;
  const V h = fill(*r->h);
  V c[C + 1], held[HELD], rate[S], total[S], q[S];
  for (long long i = 0; i < r->lanes; i += LANES) {
    begin_block(r, i, b, 0);
    for (long long k = 0; k < r->steps; k++) {
      const M active = b->steps > (double)k;
      for (int s = 0; s < S; s++) rate[s] = total[s] = fill(0.0);
      for (int g = 0; g < 4; g++) {
        if (!g || r->changes) {
          read_inputs(r, k, i, AT[g], c);
          rates_inputs(c, b->p, b->shared_r, held);
        }
        for (int s = 0; s < S; s++) q[s] = b->z[s] + AT[g] * h * rate[s];
        rates_at(q + FIRST, c, b->p, q, b->shared_r, held, rate);
        for (int s = 0; s < S; s++) total[s] = total[s] + PART[g] * rate[s];
      }
      for (int s = 0; s < S; s++) b->z[s] = choose(active, b->z[s] + h * total[s], b->z[s]);
      if (r->given) for (int s = 0; s < S; s++) {
        const V given = load(r->given + (k * S + s) * r->lanes + i);
        b->z[s] = choose(given == given, given, b->z[s]);
      }
      keep_states(r, k, i, b->z);
    }
  }
  free(base);
  return 0;
}

static V* room(V** at, long long size) { V* here = *at; *at += size; return here; }
/* A row of vectors of the lanes from i on, of the wanted columns, to the row at of each of their intervals, which has
   ``all`` rows. */
static void give_rows(const Run* r, long long i, const V* from, double* to, long long at, long long all) {
  const long long wide = r->columns ? r->wide : N;
  for (int l = 0; l < LANES; l++) {
    if (r->slot[i + l] < 0) continue;
    double* row = to + (r->interval[i + l] * all + at) * wide;
    for (long long n = 0; n < wide; n++) row[n] = from[r->columns ? r->columns[n] : n][l];
  }
}

static Work* work(const Run* r, int order, void** base) {
  const long long K = r->steps, panel = STACK * (S + R) * TILE;
  const long long size = K * (4 * (NJ + Q) + C) + (S + 4 * MIXED) * W
    + (order == 2 ? K * 4 * Q * W + (K + 1) * FIRST * W + NH + OWN + 1 + 2 * panel * (W / TILE) + W * W : 0);
  Work* w = aligned(sizeof *w + sizeof(V) * (size_t)size, base);
  if (!w) return 0;
  V* at = (V*)(w + 1);
  w->panel = panel;
  w->even = w->odd = 0;
  w->J = room(&at, K * 4 * NJ); w->q = room(&at, K * 4 * Q); w->c = room(&at, K * C); w->Z = room(&at, S * W);
  w->own = room(&at, 4 * MIXED * W);
  memset(w->own, 0, sizeof(V) * 4 * MIXED * W);
  w->kept = order < 2 ? 0 : r->middle ? 1 | 1 << MIDDLE : 15;
  if (order < 2) return w;
  w->G = room(&at, K * 4 * Q * W); w->F = room(&at, (K + 1) * FIRST * W); w->X = room(&at, NH);
  w->sum = room(&at, OWN + 1);
  w->A = room(&at, panel * (W / TILE)); w->B = room(&at, panel * (W / TILE)); w->product = room(&at, W * W);
  return w;
}

/* Stages of step k: states, rates and their derivatives. */
static void one_step(const Run* r, Work* w, long long k, long long i) {
  const V h = fill(*r->h);
  const M active = w->b.steps > (double)k;
  V held[HELD], rate[S], total[S], d[S + NJ], *c = w->c + k * C;
  for (int s = 0; s < S; s++) rate[s] = total[s] = fill(0.0);
  for (int g = 0; g < 4; g++) {
    if (!g || r->changes) {
      read_inputs(r, k, i, AT[g], c);
      jacobian_inputs(c, w->b.p, w->b.shared_j, held);
    }
    V* q = w->q + (k * 4 + g) * Q;
    for (int s = 0; s < Q; s++) q[s] = w->b.z[FIRST + s] + AT[g] * h * rate[FIRST + s];
    jacobian_at(q, c, w->b.p, q, w->b.shared_j, held, d);
    memcpy(rate, d, sizeof(V) * S);
    memcpy(w->J + (k * 4 + g) * NJ, d + S, sizeof(V) * NJ);
    for (int s = 0; s < S; s++) total[s] = total[s] + PART[g] * rate[s];
  }
  for (int s = 0; s < S; s++) w->b.z[s] = choose(active, w->b.z[s] + h * total[s], w->b.z[s]);
  keep_states(r, k, i, w->b.z);
}

static void sweep(const Run* r, Work* w, long long i, int order) {
  V slope[W], pull[S];
  begin_block(r, i, &w->b, order);
  memset(w->Z, 0, sizeof(V) * S * W);
  for (int s = 0; s < S; s++) w->Z[s * W + s] = fill(1.0);
  memset(slope, 0, sizeof slope);
  for (long long k = 0; k < r->steps; k++) {
    if (order == 2) memcpy(w->F + k * FIRST * W, w->Z, sizeof(V) * FIRST * W);
    one_step(r, w, k, i);
    const int inside = k < r->steps - 1;
    if (inside) for (int s = 0; s < S; s++) pull[s] = load(r->pull + (k * S + s) * r->lanes + i);
    through(r, w, k, fill(*r->h), w->b.steps > (double)k, inside ? pull : 0, slope);
  }
  if (order == 2) memcpy(w->F + r->steps * FIRST * W, w->Z, sizeof(V) * FIRST * W);
  if (r->columns) for (long long n = 0; n < r->tall; n++) give_rows(r, i, w->Z + r->states[n] * W, r->ends, n, r->tall);
  else for (int s = 0; s < S; s++) give_rows(r, i, w->Z + s * W, r->ends, s, S);
  give_rows(r, i, slope, r->slope, 0, 1);
}

EXPORT int linearise(const Run* r) {
  void* base;
  Work* w = work(r, 1, &base);
  for (long long i = 0; w && i < r->lanes; i += LANES) sweep(r, w, i, 1);
  free(base);
  return w == 0;
}

/* The multipliers u of the rates of stage g of step k, and what they add to the adjoints ``back`` of its begin. */
static void back_stage(const Run* r, const Work* w, long long k, int g, const V* adjoint, V* u, V* later, V* back) {
  const V h = fill(*r->h);
  const M active = w->b.steps > (double)k;
  V moved[Q];
  for (int s = 0; s < S; s++) u[s] = choose(active, h * PART[g] * adjoint[s] + later[s], fill(0.0));
  pulled(w->J + (k * 4 + g) * NJ, u, moved);
  for (int s = 0; s < Q; s++) { back[FIRST + s] += moved[s]; later[FIRST + s] = h * AT[g] * moved[s]; }
}

EXPORT int gradient(const Run* r) {
  void* base;
  Work* w = work(r, 1, &base);
  for (long long i = 0; w && i < r->lanes; i += LANES) {
    V slope[W], adjoint[S], later[S], u[S];
    begin_block(r, i, &w->b, 1);
    for (long long k = 0; k < r->steps; k++) one_step(r, w, k, i);
    for (int c = S; c < W; c++) slope[c] = fill(0.0);
    for (int s = 0; s < S; s++) slope[s] = load(r->weight + s * r->lanes + i);
    for (long long k = r->steps - 1; k >= 0; k--) {
      if (k < r->steps - 1) for (int s = 0; s < S; s++) slope[s] += load(r->pull + (k * S + s) * r->lanes + i);
      for (int s = 0; s < S; s++) { later[s] = fill(0.0); adjoint[s] = slope[s]; }
      for (int g = 3; g >= 0; g--) {
        back_stage(r, w, k, g, adjoint, u, later, slope);
        pulled_free(w->J + (k * 4 + g) * NJ, u, slope + S);
      }
    }
    give_rows(r, i, slope, r->slope, 0, 1);
  }
  free(base);
  return w == 0;
}

#if CURVE
static const V* sensitivity(const Work* w, long long k, int s) {
  return s < FIRST ? w->F + (k * FIRST + s) * W : w->G + (k * 4 * Q + s - FIRST) * W;
}

/* Rows of the cost of the samples after step k: the sensitivities of the states, then the own coefficients. */
static void add_samples(const Run* r, Work* w, long long k, long long i) {
  const int size = S + (int)r->extra;
  const double* cost = r->cost + k * (size * (size + 1) / 2) * r->lanes + i;
  for (int a = 0; a < size; a++) {
    V each[S + 1];
    int used = 0;
    for (int b = 0; b < size; b++) {  /* row a of the symmetric matrix, of which the upper triangle is given */
      const int low = a < b ? a : b, high = a < b ? b : a;
      const V f = 0.5 * load(cost + (low * (2 * size - low - 1) / 2 + high) * r->lanes);
      if (!any(f != 0.0)) continue;
      if (b < S) { each[used] = f; w->state[used++] = b; continue; }
      if (a < S) column(w, S + (int)r->own[b - S], f, sensitivity(w, k + 1, a));
      else w->product[AB(S + r->own[a - S], S + r->own[b - S])] += f;
    }
    if (a >= S) {
      for (int n = 0; n < used; n++) across(w, S + (int)r->own[a - S], each[n], sensitivity(w, k + 1, w->state[n]));
      continue;
    }
    if (!used) continue;
    const V *Z = sensitivity(w, k + 1, a), *other[S + 1];
    for (int n = 0; n < used; n++) other[n] = sensitivity(w, k + 1, w->state[n]);
    V *A = w->A + w->even * TILE, *B = w->B + w->even * TILE;
    for (int t = 0; t < W; t += TILE, A += w->panel, B += w->panel)
      for (int e = 0; e < TILE; e++) {
        V sum = each[0] * other[0][t + e];
        for (int n = 1; n < used; n++) sum = more(each[n], other[n][t + e], sum);
        A[e] = Z[t + e];
        B[e] = sum;
      }
    w->even++;
  }
}

/* Rows of stage g of step k, whose rates have the multipliers u. */
static void add_stage(Work* w, long long k, int g, const V* u, const V* held) {
  const V *G = w->G + (k * 4 + g) * Q * W, *q = w->q + (k * 4 + g) * Q;
  hessian_at(q, w->c + k * C, w->b.p, u, w->b.shared_h, held, w->X);
  const long long at = (STACK * S + w->odd) * TILE;
  bent(w->X, G, w->A + at, w->B + at, w->panel, w->sum);
  edge(w->X, G, w);
  w->odd += R;
}

/* Rows of step k from the adjoints of its end, which are moved to its begin. */
static void add_stages(const Run* r, Work* w, long long k, V* adjoint) {
  V held[HELD], later[S], back[S], u[S], whole[S];
  hessian_inputs(w->c + k * C, w->b.p, w->b.shared_h, held);
  for (int s = 0; s < S; s++) { later[s] = whole[s] = fill(0.0); back[s] = adjoint[s]; }
  for (int g = 3; g >= 0; g--) {
    back_stage(r, w, k, g, adjoint, u, later, back);
    if (r->middle) for (int s = 0; s < S; s++) whole[s] += u[s];
    else add_stage(w, k, g, u, held);
  }
  for (int s = 0; s < S; s++) adjoint[s] = back[s];
  if (r->middle) add_stage(w, k, MIDDLE, whole, held);
}

static V twice(const Work* w, int a, int b) { return w->product[AB(a, b)] + w->product[AB(b, a)]; }

static void add_shared(const Run* r, long long i, int a, int b, V x) {
  for (int l = 0; l < LANES; l++) if (r->slot[i + l] >= 0) r->shared[(r->slot[i + l] * P + a) * P + b] += x[l];
}

static void clear_sums(Work* w) {
  for (int e = 0; e < OWN; e++) w->sum[e] = fill(0.0);
  memset(w->product, 0, sizeof(V) * W * W);
}

static void add_coefficients(const Run* r, const Work* w, long long i) {
  for (int a = S; a < N; a++) for (int b = a; b < N; b++) add_shared(r, i, a - S, b - S, twice(w, a, b));
  for (int e = 0; e < OWN; e++) add_shared(r, i, own_at[e][0], own_at[e][1], w->sum[e]);
}

EXPORT int curve(const Run* r) {
  void* base;
  Work* w = work(r, 2, &base);
  if (w) clear_sums(w);
  for (long long i = 0; w && i < r->lanes; i += LANES) {
    sweep(r, w, i, 2);
    V adjoint[S];
    for (int s = 0; s < S; s++) adjoint[s] = r->weight ? load(r->weight + s * r->lanes + i) : fill(0.0);
    for (long long k = r->steps - 1; k >= 0; k--) {
      if (w->even + S > STACK * S || w->odd + (r->middle ? R : 4 * R) > STACK * R) multiply(w);
      if (k < r->steps - 1) {
        add_samples(r, w, k, i);
        if (r->weight) for (int s = 0; s < S; s++) adjoint[s] += load(r->pull + (k * S + s) * r->lanes + i);
      }
      if (r->weight) add_stages(r, w, k, adjoint);
    }
    multiply(w);
    for (int a = 0; a < S; a++) {
      V row[N];
      for (int b = 0; b < N; b++) row[b] = twice(w, a, b);
      give_rows(r, i, row, r->rows, a, S);
    }
    for (int a = 0; a < S; a++) for (int b = 0; b < N; b++) w->product[AB(a, b)] = w->product[AB(b, a)] = fill(0.0);
    if (i + LANES < r->lanes && !memcmp(r->slot + i, r->slot + i + LANES, LANES * sizeof *r->slot)) continue;
    add_coefficients(r, w, i);
    clear_sums(w);
  }
  free(base);
  return w == 0;
}
#endif
