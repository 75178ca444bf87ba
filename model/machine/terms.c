/* The sum of kernels that are repeated over an arm: each adds what it finds; see model/machine/repeated.c. */

typedef struct {
  void (*run)(long count, const double *x, const double *c, const double *lam, const int *unknowns,
              const int *rows, const int *places, double *found);
  const int *unknowns, *rows, *places;
  long count, numbers; /* how often, and where its numbers begin */
} term_t;

void evaluate(const term_t *terms, long n, const double *x, const double *p, const double *lam,
              double *found) {
  for (const term_t *t = terms; t < terms + n; ++t)
    t->run(t->count, x, p + t->numbers, lam, t->unknowns, t->rows, t->places, found);
}
