/* A function for many sets of arguments, LANES of them in a vector of the processor. functions.py
   replaces the names that end in an underscore. Contraction of products and sums is off, so that
   results are identical to the interpreter's. */
#include <math.h>

#define LANES LANES_
/* Python's spelling of constants. */
#define nan NAN
#define inf INFINITY
typedef double lanes __attribute__((vector_size(8 * LANES)));
typedef lanes unaligned __attribute__((aligned(8)));
typedef long long mask __attribute__((vector_size(8 * LANES)));

#define EACH(name) \
  static inline lanes each_##name(lanes a) { \
    for (int i = 0; i < LANES; ++i) a[i] = name(a[i]); \
    return a; \
  }
EACH(sqrt) EACH(sin) EACH(cos) EACH(exp) EACH(asin) EACH(fabs)
static inline lanes all(double a) { return (lanes){0} + a; }
static inline lanes truth(mask c) { return (lanes)((mask)all(1.0) & c); }
static inline lanes where(lanes c, lanes a) { return (lanes)((mask)a & (c != 0.0)); }
static inline lanes either(mask c, lanes a, lanes b) { return (lanes)((mask)a & c | (mask)b & ~c); }
static inline lanes each_fmin(lanes a, lanes b) { return either((a < b) | (b != b), a, b); }
static inline lanes each_fmax(lanes a, lanes b) { return either((a > b) | (b != b), a, b); }

static inline void function(const lanes *y, lanes *r) {
BODY_
}

/* in[i] is (steps, size, n), or (steps, size, 1) if it is the same for all sets. out[i] is (steps,
   size, n), or (size, n) of the last step unless `every` is set. in[0] is (size, n) of the first
   step; later steps use out[0] of the previous step. If n < LANES, the remaining lanes are 0;
   otherwise the last vector overlaps the previous one. */
void columns(long n, long steps, long every, const long *same, const double *const *in,
             double *const *out) {
  static const int sizes_in[] = {SIZES_IN_, 0}, sizes_out[] = {SIZES_OUT_, 0};
  const long some = n < LANES ? n : LANES;
  lanes y[N_Y_ + 1], r[N_R_ + 1];
  for (long next = 0; next < n; next += LANES) {
    const long first = next + some <= n ? next : n - some;
    for (long k = 0; k < steps; ++k) {
      lanes *to = y, *from = r;
      for (int i = 0; i < N_IN_; ++i)
        for (long j = 0; j < sizes_in[i]; ++j, ++to) {
          const double *set = in[i] + (k * sizes_in[i] + j) * (same[i] ? 1 : n) + !same[i] * first;
          if (i == 0 && k > 0) *to = r[j];
          else if (same[i]) *to = all(*set);
          else if (some == LANES) *to = *(const unaligned *)set;
          else for (long l = 0; l < LANES; ++l) (*to)[l] = l < some ? set[l] : 0.0;
        }
      function(y, r);
      if (!every && k + 1 < steps) continue;
      for (int i = 0; i < N_OUT_; ++i)
        for (long j = 0; j < sizes_out[i]; ++j, ++from) {
          double *set = out[i] + ((every ? k : 0) * sizes_out[i] + j) * n + first;
          if (some == LANES) *(unaligned *)set = *from;
          else for (long l = 0; l < some; ++l) set[l] = (*from)[l];
        }
    }
  }
}
