/* The program of planner/program/explicit_numbers.py as C: what is found along the arm, see
   model/unloaded/condensed_steps.c, is handed to functions of the targets, which CasADi evaluates.
   Matrices of theirs are stored by columns. */
#include <string.h>

enum { POSE = 7, STRAINS = 3, STRETCH = 2 };

/* All nodes of an arm, or slim places: an arm_t and a found_t of condensed_steps.c, and numbers in it. */
typedef struct {
  const void *arm, *found;
  double *T, *weights, *hessian;
  const double *poses, *jacobian, *strains, *by_tensions;
} place_t;

/* A function that CasADi evaluates: what runs it, and the numbers it is given and finds. */
typedef struct {
  void *run;
  double **given, **found;
} function_t;

/* n_free unknowns, of which the first n are tensions in units; m constraints; K nodes (`seen`) and r
   slim places that targets and limits look at. f and g are what was found last. */
typedef struct {
  long n, n_free, m, K, r, n_weights;
  const long *seen;
  const double *unit;
  double *f, *g;
  place_t along, slim;
  void (*poses_of)(const void *, const void *, const double *);
  void (*jacobian_of)(const void *, const void *, const double *);
  void (*strains_of)(const void *, const void *, const double *, long, long);
  void (*hessian_of)(const void *, const void *, const double *, double *);
  void (*bent_of)(const void *, const void *, const double *, double *);
  void *(*call)(void *);
  void (*drop)(void *);
  function_t value, first, weights, second;
} explicit_t;

static int ran(const explicit_t *p, const function_t *f) {
  void *done = p->call(f->run);
  if (done) p->drop(done);
  return done != 0;
}

static void take_tensions(const explicit_t *p, const double *x) {
  for (long j = 0; j < p->n; ++j) p->along.T[j] = p->slim.T[j] = x[j] * p->unit[j];
}

/* x, poses and stretch: the first, third and fourth of what all of the functions are given. */
static void give(const explicit_t *p, const function_t *f, const double *x) {
  memcpy(f->given[0], x, p->n_free * sizeof(double));
  for (long k = 0; k < p->K; ++k)
    memcpy(f->given[2] + k * POSE, p->along.poses + p->seen[k] * POSE, POSE * sizeof(double));
  for (long k = 0; k < p->r; ++k) f->given[3][k] = 1 + p->slim.strains[k * STRAINS + STRETCH];
}

/* The derivatives (POSE K + r, n) of these by the tensions. */
static void give_derivatives(const explicit_t *p, double *seen) {
  const long n = p->n, rows = POSE * p->K + p->r;
  for (long j = 0; j < n; ++j) {
    double *column = seen + j * rows;
    for (long k = 0; k < p->K; ++k)
      for (long i = 0; i < POSE; ++i)
        *column++ = p->along.jacobian[(p->seen[k] * POSE + i) * n + j];
    for (long k = 0; k < p->r; ++k)
      *column++ = p->slim.by_tensions[(k * STRAINS + STRETCH) * n + j];
  }
}

static void keep(const explicit_t *p, double **found, long f, long g) {
  *p->f = *found[f];
  memcpy(p->g, found[g], p->m * sizeof(double));
}

/* Below 0 where that fails. */
int explicit_value(explicit_t *p, const double *x, const double *change) {
  (void)change;
  take_tensions(p, x);
  p->poses_of(p->along.arm, p->along.found, p->along.T);
  p->strains_of(p->slim.arm, p->slim.found, p->slim.T, 0, p->r);
  give(p, &p->value, x);
  if (!ran(p, &p->value)) return -1;
  keep(p, p->value.found, 0, 1);
  return 1;
}

int explicit_first(explicit_t *p, const double *x) {
  take_tensions(p, x);
  p->jacobian_of(p->along.arm, p->along.found, p->along.T);
  p->strains_of(p->slim.arm, p->slim.found, p->slim.T, 0, p->r);
  give(p, &p->first, x);
  give_derivatives(p, p->first.given[4]);
  if (!ran(p, &p->first)) return 0;
  keep(p, p->first.found, 0, 2);
  return 1;
}

/* The Hessian of sigma f + lam . g where explicit_first was last. */
int explicit_second(explicit_t *p, const double *x, double sigma, const double *lam) {
  const long n = p->n;
  double **last = p->second.given;
  give(p, &p->weights, x);
  p->weights.given[4][0] = last[5][0] = sigma;
  memcpy(p->weights.given[5], lam, p->m * sizeof(double));
  memcpy(last[6], lam, p->m * sizeof(double));
  if (!ran(p, &p->weights)) return 0;
  memset(p->along.weights, 0, p->n_weights * sizeof(double));
  for (long k = 0; k < p->K; ++k)
    memcpy(p->along.weights + p->seen[k] * POSE, p->weights.found[0] + k * POSE,
           POSE * sizeof(double));
  for (long k = 0; k < p->r; ++k)
    p->slim.weights[k * STRAINS + STRETCH] = p->weights.found[1][k];
  p->hessian_of(p->along.arm, p->along.found, p->along.weights, p->along.hessian);
  p->bent_of(p->slim.arm, p->slim.found, p->slim.weights, p->slim.hessian);
  give(p, &p->second, x);
  give_derivatives(p, last[4]);
  for (long i = 0; i < n; ++i)
    for (long j = 0; j < n; ++j)
      last[7][j * n + i] = p->along.hessian[i * n + j] + p->slim.hessian[i * n + j];
  return ran(p, &p->second);
}
