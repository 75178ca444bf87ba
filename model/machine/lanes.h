/* Numbers of LANES arms side by side, as the processor's vector units take them. Contraction of
   products and sums is off, so that the digits are those of the interpreter. */
#include <math.h>

typedef double lanes __attribute__((vector_size(8 * LANES)));
typedef long long mask __attribute__((vector_size(8 * LANES)));

#define EACH(name, of) \
  static inline lanes each_##name(lanes a) { \
    for (int i = 0; i < LANES; ++i) a[i] = of(a[i]); \
    return a; \
  }
#define EACH_PAIR(name, of) \
  static inline lanes each_##name(lanes a, lanes b) { \
    for (int i = 0; i < LANES; ++i) a[i] = of(a[i], b[i]); \
    return a; \
  }
EACH(sqrt, sqrt)
EACH(sin, sin)
EACH(cos, cos)
EACH(exp, exp)
EACH(asin, asin)
EACH(fabs, fabs)
EACH_PAIR(fmin, fmin)
EACH_PAIR(fmax, fmax)
static inline lanes all(double a) { return (lanes){0} + a; }
static inline lanes truth(mask c) { return (lanes)((mask)all(1.0) & c); }
static inline lanes where(lanes c, lanes a) { return (lanes)((mask)a & (c != 0.0)); }
