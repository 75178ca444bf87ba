/* The program of planner/program/condensed.py and reduced.py as C, where states are eliminated. What is
   done, and why, is told there. Matrices are stored by columns; LAPACK and BLAS are those of SciPy. */
#include <math.h>
#include <string.h>

/* A function that CasADi evaluates: what runs it, and the numbers it is given and finds. */
typedef struct {
  void *run;
  double **given, **found;
} function_t;

/* A sum of repeated kernels, see model/machine/terms.c. */
typedef struct {
  const void *terms;
  long count, size;
  double *found;
} sum_t;

/* A sparse matrix, column by column. */
typedef struct {
  const int *rows, *ends;
  const double *nonzeros;
} matrix_t;

/* n tensions, n_free unknowns before the states, which are `states` with the load factor first; m
   constraints. Of the equations' Jacobian the nonzeros `inside` stand at `stored` in the band, those
   `outside` at `sides` of the right-hand sides: tensions, then the load factor. */
typedef struct {
  long n, n_free, m, states, followed;
  int below, above, n_inside, n_outside;
  double near, shrinks;
  const long *inside, *stored, *outside, *sides;
  const double *whole, *row_scale, *numbers;
  void (*evaluate)(const void *, long, const double *, const double *, const double *, double *);
  void (*factor)(int *, int *, int *, int *, double *, int *, int *, int *);
  void (*substitute)(char *, int *, int *, int *, int *, double *, int *, int *, double *, int *, int *);
  void (*multiply)(char *, char *, int *, int *, int *, double *, double *, int *, double *, int *,
                   double *, double *, int *);
  void (*apply)(char *, int *, int *, double *, double *, int *, double *, int *, double *, double *,
                int *);
  void *(*call)(void *);
  void (*drop)(void *);
  function_t values, first, outer;
  sum_t value, jacobian, hessian;
  matrix_t own, inner;
  /* Where it is linearised, and where a step led; in units, in SI. */
  double *x, *trial, *X;
  double *band, *right, *moves, *slopes, *moved, *product, *found, *multipliers;
  int *pivots;
  double *f, *g, *gradient, *J, *H, *more, *off;
} condensed_t;

static int ran(const condensed_t *p, const function_t *f) {
  void *done = p->call(f->run);
  if (done) p->drop(done);
  return done != 0;
}

static long size_of(const condensed_t *p) { return p->n_free + p->states; }

static int height(const condensed_t *p) { return 2 * p->below + p->above + 1; }

static void evaluate(condensed_t *p, const sum_t *of, const double *x, const double *lam) {
  for (long i = 0; i < size_of(p); ++i) p->X[i] = x[i] * p->whole[i];
  memset(of->found, 0, of->size * sizeof(double));
  p->evaluate(of->terms, of->count, p->X, p->numbers, lam, of->found);
}

static void solve(condensed_t *p, double *right, int sides, char transposed) {
  int n = p->states - 1, rows = height(p), info;
  p->substitute(&transposed, &n, &p->below, &p->above, &sides, p->band, &rows, p->pivots, right, &n,
                &info);
}

/* moves = (Z, z): how the states follow; 0 where the equations are singular. */
static int eliminate(condensed_t *p, const double *x) {
  int n = p->states - 1, rows = height(p), info;
  const double *column = p->whole + p->n_free + 1;
  evaluate(p, &p->jacobian, x, x);
  memset(p->band, 0, (long)n * rows * sizeof(double));
  for (long k = 0; k < p->n_inside; ++k) p->band[p->stored[k]] = p->jacobian.found[p->inside[k]];
  p->factor(&n, &n, &p->below, &p->above, p->band, &rows, p->pivots, &info);
  if (info) return 0;
  for (long k = 0; k < (long)n * rows; ++k)
    if (!isfinite(p->band[k])) return 0;
  memset(p->right, 0, (p->n + 1) * n * sizeof(double));
  for (long k = 0; k < p->n_outside; ++k) p->right[p->sides[k]] = p->jacobian.found[p->outside[k]];
  solve(p, p->right, p->n + 1, 'N');
  for (long j = 0; j < p->n; ++j)
    for (long i = 0; i < n; ++i)
      p->moves[j * p->states + 1 + i] = -p->right[j * n + i] * p->whole[j] / column[i];
  evaluate(p, &p->value, x, x);
  solve(p, p->value.found, 1, 'N');
  double *shift = p->moves + p->n_free * p->states;
  *p->off = 0.0;
  for (long i = 0; i < n; ++i) {
    shift[1 + i] = -p->value.found[i] / column[i];
    *p->off = fmax(*p->off, fabs(shift[1 + i]));
  }
  return 1;
}

/* Linearise at the trial; 0 where that fails, and all that counts stays. */
int condensed_first(condensed_t *p, const double *free) {
  const long n = p->n_free, m = p->m, states = p->states;
  (void)free;
  if (!eliminate(p, p->trial)) return 0;
  memcpy(p->first.given[0], p->trial, size_of(p) * sizeof(double));
  if (!ran(p, &p->first)) return 0;
  const double *gradient = p->first.found[1], *g = p->first.found[2], *J = p->first.found[3];
  for (long s = 0; s < states; ++s) {
    memcpy(p->slopes + s * (m + 1), J + (n + s) * m, m * sizeof(double));
    p->slopes[s * (m + 1) + m] = gradient[n + s];
  }
  int rows = m + 1, columns = n + 1, inner = states;
  double one = 1.0, none = 0.0;
  char no = 'N';
  p->multiply(&no, &no, &rows, &columns, &inner, &one, p->slopes, &rows, p->moves, &inner, &none,
              p->moved, &rows);
  for (long j = 0; j < n; ++j) {
    for (long i = 0; i < m; ++i) p->J[j * m + i] = J[j * m + i] + p->moved[j * rows + i];
    p->gradient[j] = gradient[j] + p->moved[j * rows + m];
  }
  for (long i = 0; i < m; ++i) p->g[i] = g[i] + p->moved[n * rows + i];
  *p->f = p->first.found[0][0];
  memcpy(p->x, p->trial, size_of(p) * sizeof(double));
  return 1;
}

/* All unknowns after a change of those before the states, near equilibrium, as the trial; 0 where the
   states do not come near it. */
int condensed_follow(condensed_t *p, const double *change) {
  const long n = p->n_free, states = p->states;
  double *x = p->found, last = INFINITY, one = 1.0;
  const double *shift = p->moves + n * states, *column = p->whole + n + 1;
  int rows = states, columns = n, step = 1;
  char no = 'N';
  memcpy(x, p->x, size_of(p) * sizeof(double));
  for (long j = 0; j < n; ++j) x[j] += change[j];
  memcpy(p->product, shift, states * sizeof(double));
  p->apply(&no, &rows, &columns, &one, p->moves, &rows, (double *)change, &step, &one, p->product,
           &step);
  for (long s = 0; s < states; ++s) x[n + s] += p->product[s];
  for (long k = 0; k < p->followed; ++k) {
    double most = 0.0;
    evaluate(p, &p->value, x, x);
    double *r = p->value.found;
    for (long i = 0; i < states - 1; ++i) r[i] = r[i] / p->row_scale[i] * p->row_scale[i];
    solve(p, r, 1, 'N');
    for (long i = 0; i < states - 1; ++i) {
      r[i] /= column[i];
      if (most == most && !(fabs(r[i]) <= most)) most = fabs(r[i]);
    }
    if (!(most <= p->shrinks * last)) return 0;
    for (long i = 0; i < states - 1; ++i) x[n + 1 + i] -= r[i];
    if (most <= p->near) {
      memcpy(p->trial, x, size_of(p) * sizeof(double));
      return 1;
    }
    last = most;
  }
  return 0;
}

/* Objective and constraints after a change; 0 where the states do not follow, below where that fails. */
int condensed_value(condensed_t *p, const double *free, const double *change) {
  (void)free;
  if (!condensed_follow(p, change)) return 0;
  memcpy(p->values.given[0], p->trial, size_of(p) * sizeof(double));
  if (!ran(p, &p->values)) return -1;
  *p->f = p->values.found[0][0];
  memcpy(p->g, p->values.found[1], p->m * sizeof(double));
  return 1;
}

/* product += A columns, of a sparse matrix and columns (size, k) stored by rows. */
static void add_product(const matrix_t *A, const double *columns, long size, long k, double *product) {
  for (long j = 0; j < size; ++j)
    for (long i = A->ends[j]; i < A->ends[j + 1]; ++i) {
      double *row = product + A->rows[i] * k;
      for (long l = 0; l < k; ++l) row[l] += A->nonzeros[i] * columns[j * k + l];
    }
}

/* The Hessian of sigma f + lam . g where it is linearised, and the slope that states off add. */
int condensed_second(condensed_t *p, const double *free, double sigma, const double *lam) {
  const long n = p->n_free, m = p->m, states = p->states, size = size_of(p), k = n + 1;
  const double *column = p->whole + n + 1;
  double one = 1.0, none = 0.0, weights[m + 1], *mu = p->multipliers;
  int rows = m + 1, columns = states, step = 1;
  char yes = 'T', no = 'N';
  (void)free;
  memcpy(weights, lam, m * sizeof(double));
  weights[m] = sigma;
  p->apply(&yes, &rows, &columns, &one, p->slopes, &rows, weights, &step, &none, p->product, &step);
  for (long i = 0; i < states - 1; ++i) mu[i] = p->product[1 + i] / column[i];
  solve(p, mu, 1, 'T');
  for (long i = 0; i < states - 1; ++i) mu[i] = -(p->row_scale[i] * mu[i]) / p->row_scale[i];
  evaluate(p, &p->hessian, p->x, mu);
  memcpy(p->outer.given[0], p->x, size * sizeof(double));
  p->outer.given[2][0] = sigma;
  memcpy(p->outer.given[3], lam, m * sizeof(double));
  if (!ran(p, &p->outer)) return 0;
  /* Rows of (1, Z; 0, z), in units and then in SI. */
  double *M = p->found, *P = p->product, *B = P + size * k;
  memset(M, 0, n * k * sizeof(double));
  for (long j = 0; j < n; ++j) M[j * k + j] = 1.0;
  for (long s = 0; s < states; ++s)
    for (long l = 0; l < k; ++l) M[(n + s) * k + l] = p->moves[l * states + s];
  memset(P, 0, 2 * size * k * sizeof(double));
  add_product(&p->own, M, size, k, P);
  for (long i = 0; i < size; ++i)
    for (long l = 0; l < k; ++l) M[i * k + l] *= p->whole[i];
  add_product(&p->inner, M, size, k, B);
  for (long i = 0; i < size; ++i)
    for (long l = 0; l < k; ++l) P[i * k + l] += p->whole[i] * B[i * k + l];
  for (long j = 0; j < n; ++j)
    for (long l = 0; l < k; ++l) M[j * k + l] = j == l;
  for (long s = 0; s < states; ++s)
    for (long l = 0; l < k; ++l) M[(n + s) * k + l] = p->moves[l * states + s];
  int outside = k, free_columns = n, inside = size;
  p->multiply(&no, &yes, &outside, &free_columns, &inside, &one, P, &outside, M, &outside, &none, B,
              &outside);
  for (long j = 0; j < n; ++j) {
    for (long l = 0; l < n; ++l) p->H[j * n + l] = B[j * k + l];
    p->more[j] = B[j * k + n];
  }
  return 1;
}
