#define LANES @lanes@
typedef double V __attribute__((vector_size(8 * LANES)));
typedef long long M __attribute__((vector_size(8 * LANES)));
typedef unsigned long long U __attribute__((vector_size(8 * LANES)));
#define bits(x) ((U)(x))
#define real(x) ((V)(x))
#define LANEWISE(e) V y; for (int i = 0; i < LANES; i++) y[i] = (e); return y
INLINE V load(const double* p) { V x; memcpy(&x, p, sizeof x); return x; }
static inline void store(double* p, V x) { memcpy(p, &x, sizeof x); }
INLINE V fill(double a) { return a - (V){0}; }  /* minus: -0.0 + 0 would be 0 */
INLINE V choose(M m, V a, V b) { return real(((U)m & bits(a)) | (~(U)m & bits(b))); }
#if defined(__AVX512DQ__) && defined(__GNUC__) && !defined(__clang__)
#define ALL_LANES (unsigned char)-1
#define any(m) (__builtin_ia32_cvtq2mask512(m) != 0)
INLINE V more(V a, V b, V c) { return __builtin_ia32_vfmaddpd512_mask(a, b, c, ALL_LANES, 4); }
#else
INLINE int any(M m) { long long y = 0; for (int i = 0; i < LANES; i++) y |= m[i]; return y != 0; }
#if defined(__FMA__) || defined(__ARM_FEATURE_FMA)
INLINE V more(V a, V b, V c) { LANEWISE(__builtin_fma(a[i], b[i], c[i])); }
#else
INLINE V more(V a, V b, V c) { return a * b + c; }
#endif
#endif
INLINE V each_sqrt(V x) { LANEWISE(__builtin_sqrt(x[i])); }
static V each_sin(V x) { LANEWISE(sin(x[i])); }
static V each_cos(V x) { LANEWISE(cos(x[i])); }
static V each_atan2(V y_, V x) { LANEWISE(atan2(y_[i], x[i])); }
#define v_sqrt each_sqrt
