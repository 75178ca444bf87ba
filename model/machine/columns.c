/* A function for many sets of arguments, LANES of them side by side as the processor's vector units
   take them; names that end in an underscore are written in by model/machine/columns.py. Contraction
   of products and sums is off, so that the digits are those of the interpreter. */
#include <math.h>

#define LANES LANES_
typedef double lanes __attribute__((vector_size(8 * LANES)));
typedef long long mask __attribute__((vector_size(8 * LANES)));

#define EACH(name) \
  static inline lanes each_##name(lanes a) { \
    for (int i = 0; i < LANES; ++i) a[i] = name(a[i]); \
    return a; \
  }
#define EACH_PAIR(name) \
  static inline lanes each_##name(lanes a, lanes b) { \
    for (int i = 0; i < LANES; ++i) a[i] = name(a[i], b[i]); \
    return a; \
  }
EACH(sqrt) EACH(sin) EACH(cos) EACH(exp) EACH(asin) EACH(fabs) EACH_PAIR(fmin) EACH_PAIR(fmax)
static inline lanes all(double a) { return (lanes){0} + a; }
static inline lanes truth(mask c) { return (lanes)((mask)all(1.0) & c); }
static inline lanes where(lanes c, lanes a) { return (lanes)((mask)a & (c != 0.0)); }

FUNCTIONS_
static inline void function(const lanes *y, lanes *r) {
CALLS_
}

/* in[i] is (rows[i], size), rows that are taken again and again, and out[i] (n, size), row by row.
   The last sets stand in for those beyond them. */
void columns(long n, const long *rows, const double *const *in, double *const *out) {
  static const int sizes_in[] = {SIZES_IN_, 0}, sizes_out[] = {SIZES_OUT_, 0};
  int n_y = 0, n_r = 0;
  for (int i = 0; i < N_IN_; ++i) n_y += sizes_in[i];
  for (int i = 0; i < N_OUT_; ++i) n_r += sizes_out[i];
  lanes y[n_y + 1], r[n_r + 1];
  long next[N_IN_ + 1] = {0};
  for (long first = 0; first < n; first += LANES) {
    const long some = n - first < LANES ? n - first : LANES;
    lanes *to = y;
    for (int i = 0; i < N_IN_; ++i) {
      const double *from[LANES];
      for (long l = 0; l < LANES; ++l) {
        from[l] = l < some ? in[i] + next[i] * sizes_in[i] : from[some - 1];
        if (l < some && ++next[i] == rows[i]) next[i] = 0;
      }
      for (int j = 0; j < sizes_in[i]; ++j, ++to)
        for (long l = 0; l < LANES; ++l) (*to)[l] = from[l][j];
    }
    function(y, r);
    const lanes *from = r;
    for (int i = 0; i < N_OUT_; ++i)
      for (int j = 0; j < sizes_out[i]; ++j, ++from)
        for (long l = 0; l < some; ++l) out[i][(first + l) * sizes_out[i] + j] = (*from)[l];
  }
}
