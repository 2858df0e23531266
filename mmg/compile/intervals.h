/* What the ship's own functions need: arguments, vectors, scratch, places of the product. */
#include <stdlib.h>
typedef struct {
  long long lanes, steps, groups, extra, middle, changes, tall, wide;
  const double *start, *controls, *theta, *h;
  const long long *count, *group, *slot, *interval;
  const double* given;
  double *end, *interior;
  const long long *states, *columns;
  const double *pull;
  double *ends, *slope;
  const double *cost, *weight;
  const long long* own;
  double *rows, *shared;
} Run;
/* start S x lanes, controls steps x C x lanes, or steps x 2 C x lanes where they have changes, theta ALL x groups;
   count, group, slot, interval by lane; a slot of -1: none, of a lane that only fills a vector; given steps x S x
   lanes: states that replace those after each step, NaN for none, or null; end S x lanes, interior (steps - 1) x S x
   lanes; pull (steps - 1) x S x lanes: gradient of the samples' cost; ends intervals x S x N and slope intervals x N,
   or of the wanted states[tall] and columns[wide]; cost (steps - 1) x (S + extra) (S + extra + 1) / 2 x lanes: upper
   triangle by rows of their Hessian to the state and to the coefficients own[extra]; weight S x lanes of the end, or
   null for none; rows intervals x S x N; shared slots x P x P, upper triangle; middle: whether second derivatives are
   taken once a step, in its middle. */

typedef struct { V p[ALL + 1], z[S], steps, shared_r[KEPT], shared_j[KEPT], shared_h[KEPT]; } Block;

/* Scratch of one block: G (steps x 4 x Q x W) sensitivities of the stages' arguments, of stages in the bits of kept, F
   (steps + 1) x FIRST x W those of the leading states before each step, J (steps x 4 x NJ), q (steps x 4 x Q), c
   (steps x C), Z (S x W) sensitivities of the state, own (4 x MIXED x W) derivatives of the rates by coefficients, A
   and B panels of TILE columns: even rows, whose product is symmetric, then odd others, until they are multiplied. */
typedef struct {
  Block b;
  V *G, *F, *J, *q, *c, *A, *B, *X, *sum, *Z, *own, *product;
  long long panel;
  int even, odd, kept;
  int state[S + 1];
} Work;

/* Where element (a, b) of the product lies: tiles of TILE x TILE, row by row. */
#define AB(a, b) (((a) / TILE * (W / TILE) + (b) / TILE) * TILE * TILE + (a) % TILE * TILE + (b) % TILE)
/* Adds x times a row of all columns to the product's row c. */
static void across(Work* w, int c, V x, const V* row) {
  for (int a = 0; a < W; a++) w->product[AB(c, a)] = more(x, row[a], w->product[AB(c, a)]);
}
/* Adds x times a row of all columns to the product's column c. */
static void column(Work* w, int c, V x, const V* row) {
  V* sum = w->product + c / TILE * TILE * TILE + c % TILE;
  for (int a = 0; a < W; a += TILE, sum += W * TILE)
    for (int e = 0; e < TILE; e++) sum[e * TILE] = more(x, row[a + e], sum[e * TILE]);
}
