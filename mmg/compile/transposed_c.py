"""C functions that take rows of numbers into the lanes of vectors and give them back, eight by eight.

Lane l belongs to row l. A row after the other is read and written in whole vectors, which are transposed between.
"""

from __future__ import annotations

TRANSPOSED = """
#ifdef __clang__
#define mixed(a, b, ...) __builtin_shufflevector(a, b, __VA_ARGS__)
#else
#define mixed(a, b, ...) __builtin_shuffle(a, b, (M){__VA_ARGS__})
#endif
#define PAIR(x, y, low, high) { const V a = x, b = y; x = mixed(a, b, low); y = mixed(a, b, high); }
#define EACH 0, 8, 2, 10, 4, 12, 6, 14
#define OTHER 1, 9, 3, 11, 5, 13, 7, 15
#define TWO 0, 1, 8, 9, 4, 5, 12, 13
#define NEXT 2, 3, 10, 11, 6, 7, 14, 15
#define HALF 0, 1, 2, 3, 8, 9, 10, 11
#define REST 4, 5, 6, 7, 12, 13, 14, 15
static inline __attribute__((always_inline)) void turned(V* x) { /* eight vectors as rows of a matrix, transposed */
  PAIR(x[0], x[1], EACH, OTHER) PAIR(x[2], x[3], EACH, OTHER)
  PAIR(x[4], x[5], EACH, OTHER) PAIR(x[6], x[7], EACH, OTHER)
  PAIR(x[0], x[2], TWO, NEXT) PAIR(x[1], x[3], TWO, NEXT) PAIR(x[4], x[6], TWO, NEXT) PAIR(x[5], x[7], TWO, NEXT)
  PAIR(x[0], x[4], HALF, REST) PAIR(x[1], x[5], HALF, REST) PAIR(x[2], x[6], HALF, REST) PAIR(x[3], x[7], HALF, REST)
}
/* count numbers of each of own rows, apart from those of the next, into lanes, of which the others have the last row */
static void taken(long long count, long long apart, int own, const double* from, V* to) {
  long long e = 0;
  for (; e + LANES <= count; e += LANES, to += LANES) {
    V x[LANES];
    for (int l = 0; l < LANES; l++) x[l] = load(from + (l < own ? l : own - 1) * apart + e);
    turned(x);
    for (int l = 0; l < LANES; l++) to[l] = x[l];
  }
  for (int l = 0; l < LANES; l++) {
    const double* p = from + (l < own ? l : own - 1) * apart;
    for (long long j = e; j < count; j++) ((double*)(to + j - e))[l] = p[j];
  }
}
/* the same back */
static void given(long long count, long long apart, int own, const V* from, double* to) {
  long long e = 0;
  for (; e + LANES <= count; e += LANES, from += LANES) {
    V x[LANES];
    for (int l = 0; l < LANES; l++) x[l] = from[l];
    turned(x);
    for (int l = 0; l < own; l++) store(to + l * apart + e, x[l]);
  }
  for (int l = 0; l < own; l++)
    for (long long j = e; j < count; j++) to[l * apart + j] = ((const double*)(from + j - e))[l];
}
"""
