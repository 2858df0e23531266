#include <stdlib.h>
#include <string.h>
#if defined(_MSC_VER) || !defined(__GNUC__)
#define restrict
#endif
typedef long long I;
typedef const double* restrict From;
typedef double* restrict To;
/* to_a += sum over b of left(a, b) right_b, rows of n numbers; left(a, b) at left[a * down + b * along] */
static void add(I S, I n, From left, I down, I along, From right, To to) {
  for (I a = 0; a < S; a++)
    for (I b = 0; b < S; b++) {
      const double f = left[a * down + b * along];
      for (I j = 0; j < n; j++) to[a * n + j] += f * right[b * n + j];
    }
}
/* intervals of window w, from its last one on: order[first[w]] .. order[first[w + 1] - 1] */
EXPORT int eliminate(I W, I S, I n, const I* first, const I* order, const I* start, const I* end, From nodes,
                     From node_slope, From inside, From inside_slope, From maps, From off, I off_row, double* rows,
                     double* slope, double* B, double* ahead, double* pull) {
  const I L = n - S, size = S * n;
  double* through = malloc(sizeof(double) * (size + n));
  if (!through) return 1;
  double* v = through + size;
  for (I w = 0; w < W; w++) {
    double *H = rows + w * size, *s = slope + w * n;
    for (I at = first[w]; at < first[w + 1]; at++) {
      const I i = order[at];
      const double* T = maps + i * size;
      if (at == first[w]) {
        memcpy(H, nodes + end[i] * size, sizeof(double) * size);
        memcpy(s, node_slope + end[i] * n, sizeof(double) * n);
      }
      memcpy(ahead + i * size, H, sizeof(double) * size);
      memcpy(pull + i * S, s, sizeof(double) * S);
      memcpy(v, s, sizeof(double) * n);
      for (I a = 0; a < S; a++)
        for (I j = 0; j < n; j++) v[j] += off[i * off_row + a] * H[a * n + j];
      memset(through, 0, sizeof(double) * size);
      add(S, n, H, n, 1, T, through);
      for (I a = 0; a < S; a++)
        for (I j = S; j < n; j++) {
          B[(i * S + a) * L + j - S] = 0.5 * through[a * n + j] + H[a * n + j];
          through[a * n + j] += H[a * n + j];
        }
      memcpy(H, nodes + start[i] * size, sizeof(double) * size);
      memcpy(s, node_slope + start[i] * n, sizeof(double) * n);
      for (I j = S; j < n; j++) s[j] += v[j];
      if (inside) {
        for (I j = 0; j < size; j++) H[j] += inside[i * size + j];
        for (I j = 0; j < n; j++) s[j] += inside_slope[i * n + j];
      }
      add(S, n, T, 1, n, through, H);
      for (I b = 0; b < S; b++)
        for (I j = 0; j < n; j++) s[j] += v[b] * T[b * n + j];
    }
  }
  free(through);
  return 0;
}
EXPORT void carry(I W, I S, I n, const I* first, const I* order, const I* start, const I* end, From maps, From off,
                  From begin, const double* p, I p_row, double* nodes) {
  for (I w = 0; w < W; w++)
    for (I at = first[w + 1] - 1; at >= first[w]; at--) {
      const I i = order[at];
      double* z = nodes + start[i] * S;
      if (at == first[w + 1] - 1) memcpy(z, begin + w * S, sizeof(double) * S);
      for (I a = 0; a < S; a++) {
        From T = maps + (i * S + a) * n;
        double sum = off[i * S + a];
        for (I b = 0; b < S; b++) sum += T[b] * z[b];
        if (p) for (I j = S; j < n; j++) sum += T[j] * p[w * p_row + j - S];
        nodes[end[i] * S + a] = sum;
      }
    }
}
