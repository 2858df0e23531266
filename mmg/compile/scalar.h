#define LANES 1
typedef double V;
typedef int M;
typedef unsigned long long U;
INLINE U bits(V x) { U y; memcpy(&y, &x, sizeof y); return y; }
INLINE V real(U x) { V y; memcpy(&y, &x, sizeof y); return y; }
#define load(p) (*(p))
#define store(p, x) (*(p) = (x))
#define fill(a) (a)
#define choose(m, a, b) ((m) ? (a) : (b))
#define any(m) (m)
#if defined(__FMA__) || defined(__ARM_FEATURE_FMA)
#define more(a, b, c) __builtin_fma(a, b, c)
#else
#define more(a, b, c) ((a) * (b) + (c))
#endif
#define each_sin sin
#define each_cos cos
#define each_atan2 atan2
#define v_sqrt sqrt
