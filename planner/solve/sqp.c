/* The steps of planner/solve/sqp.py, where a program is evaluated by C; what is done, and why, is told
   there under the same names. Sums are in the same order, so that digits are the same. Matrices are
   stored by columns. */
#include <math.h>
#include <string.h>

/* A program of n unknowns and m constraints, which may have states that follow. `value` finds f and g at x,
   a change from where `first` was last, and returns 0 where the states do not follow, less where it fails.
   `first` finds f, g and their derivatives where `value` was last, `second` the Hessian H of
   sigma f + lam . g where `first` was; they return 0 where they fail. What is found is at the pointers,
   with the slope that states off equilibrium add (`more`), and how far they are off. */
typedef struct {
  long n, m;
  void *self;
  int (*value)(void *self, const double *x, const double *change);
  int (*first)(void *self, const double *x);
  int (*second)(void *self, const double *x, double sigma, const double *lam);
  const double *f, *g, *gradient, *J, *H, *more, *off;
} program_t;

/* A solver of quadratic programs that CasADi runs (`call` runs it, `drop` what that returns): what it
   is given, in the order of CasADi's conic, and finds. */
typedef struct {
  void *run, *(*call)(void *);
  void (*drop)(void *);
  double *H, *slope, *A, *lba, *uba, *lbx, *ubx;
  const double *change, *own;
} quadratic_t;

/* Bounds; which constraints are equalities and which are not; optima known (count, n). */
typedef struct {
  const double *lbx, *ubx, *lbg, *ubg, *known;
  const long *equal, *uneven;
  long n_equal, n_uneven, n_known;
} asked_t;

/* See the constants of sqp.py. */
typedef struct {
  double met, soft, soft_late, shifted, rounding, closed, longest, local, lost, at, joined, near, alike;
  long most, late, creeps, halved;
} rules_t;

/* Where the steps are, of which `run` leaves the last: unknowns, multipliers, constraints, the
   Lagrangian's gradient, what bounds hold, residuals of all steps; and room, see ROOM. */
typedef struct {
  double *x, *lam, *g, *slope, *residuals, *room;
  long *held;
  double f;
  long steps, met, joined;
} point_t;

static double most_of(const double *v, long n) {
  double found = 0.0;
  for (long i = 0; i < n; ++i) found = fmax(found, fabs(v[i]));
  return found;
}

static int is_finite(const double *v, long n) {
  double sum = 0.0;
  for (long i = 0; i < n; ++i) sum += v[i];
  return isfinite(sum);
}

/* Whether a symmetric matrix (n, n) is positive definite; room (n, n). */
static int is_convex(const double *H, long n, double *room) {
  memcpy(room, H, n * n * sizeof(double));
  for (long j = 0; j < n; ++j) {
    double *column = room + j * n;
    if (!(column[j] > 0.0)) return 0;
    const double pivot = sqrt(column[j]);
    for (long i = j; i < n; ++i) column[i] /= pivot;
    for (long k = j + 1; k < n; ++k)
      for (long i = k; i < n; ++i) room[k * n + i] -= column[k] * column[i];
  }
  return 1;
}

static double violation(const asked_t *a, const double *g, long i) {
  return fmax(0.0, fmax(a->lbg[i] - g[i], g[i] - a->ubg[i]));
}

static double merit(const program_t *p, const asked_t *a, double weight) {
  double sum = 0.0;
  for (long i = 0; i < p->m; ++i) sum += violation(a, p->g, i);
  return *p->f + weight * sum;
}

static double residual(const program_t *p, const asked_t *a, const point_t *at) {
  double violated = *p->off, worst = 0.0;
  for (long i = 0; i < p->m; ++i) violated = fmax(violated, violation(a, at->g, i));
  for (long j = 0; j < p->n; ++j)
    if (!at->held[j]) worst = fmax(worst, fabs(at->slope[j]));
  for (long k = 0; k < a->n_uneven; ++k) {
    const long i = a->uneven[k];
    const double bound = at->lam[i] > 0 ? a->ubg[i] : a->lbg[i];
    worst = fmax(worst, fabs(at->lam[i] * fmin(fabs(bound - at->g[i]), 1e3)));
  }
  return fmax(violated, worst / (1e-2 + most_of(p->gradient, p->n) + most_of(at->lam, p->m)));
}

/* The Lagrangian's gradient where `first` was last, what is held, the residual. */
static void look(const program_t *p, const asked_t *a, const rules_t *r, point_t *at) {
  memcpy(at->g, p->g, p->m * sizeof(double));
  at->f = *p->f;
  for (long j = 0; j < p->n; ++j) {
    double sum = 0.0;
    for (long i = 0; i < p->m; ++i) sum += p->J[j * p->m + i] * at->lam[i];
    sum = at->slope[j] = p->gradient[j] + sum;
    at->held[j] = a->lbx[j] == a->ubx[j] || (at->x[j] <= a->lbx[j] + r->at && sum > 0) ||
                  (at->x[j] >= a->ubx[j] - r->at && sum < 0);
  }
  at->residuals[at->steps] = residual(p, a, at);
  at->met = at->residuals[at->steps] <= r->met;
}

/* Which known optimum is about to be come to, -1 if none is. */
static long joined(const program_t *p, const asked_t *a, const rules_t *r, const point_t *at) {
  if (at->residuals[at->steps] > r->near) return -1;
  for (long k = 0; k < a->n_known; ++k) {
    double apart = 0.0, size = 0.0;
    for (long j = 0; j < p->n; ++j) {
      const double there = a->known[k * p->n + j], off = at->x[j] - there;
      apart += off * off, size += there * there;
    }
    if (sqrt(apart) <= r->joined * sqrt(size)) return k;
  }
  return -1;
}

static int creeps(const rules_t *r, const point_t *at) {
  const long first = at->steps + 1 - r->creeps;
  double low = INFINITY, high = 0.0;
  if (first < r->late) return 0;
  for (long k = first; k <= at->steps; ++k) {
    low = fmin(low, at->residuals[k]);
    high = fmax(high, at->residuals[k]);
  }
  return high <= r->alike * low;
}

/* Make a Hessian convex: among what is not held by as little as that takes, from the shift `least` on;
   room 2 (n, n). */
static int convex(double *H, const long *held, long n, double least, const rules_t *r, double *room) {
  double *inner = room + n * n, largest = most_of(H, n * n), most = 0.0, shift = 0.0, extra;
  long free = 0, which[n], tries = 0;
  if (is_convex(H, n, room)) return 1;
  for (long j = 0; j < n; ++j) {
    most = fmax(most, r->soft * fabs(H[j * n + j]));
    if (!held[j]) which[free++] = j;
  }
  least = fmax(least, r->rounding * largest);
  for (;; shift = fmax(least, 4 * shift)) {
    for (long k = 0; k < free; ++k)
      for (long i = 0; i < free; ++i)
        inner[k * free + i] = H[which[k] * n + which[i]] + (i == k ? shift : 0.0);
    if (is_convex(inner, free, room)) break;
    if (!(shift <= 1e9 * largest) || ++tries > 200) return 0;
  }
  extra = fmax(shift, most);
  for (tries = 0; tries <= 200; ++tries) {
    memcpy(inner, H, n * n * sizeof(double));
    for (long j = 0; j < n; ++j) inner[j * n + j] += held[j] ? extra : shift;
    if (is_convex(inner, n, room)) {
      memcpy(H, inner, n * n * sizeof(double));
      return 1;
    }
    extra *= 4;
    if (extra > largest) shift = fmax(least, 4 * shift);
  }
  return 0;
}

/* The step of the quadratic program, and the multipliers after it; 0 where there is none. */
static int step(const program_t *p, quadratic_t *q, const asked_t *a, const rules_t *r,
                const point_t *at, double *change, double *after) {
  const long n = p->n, m = p->m;
  const double soft = at->steps < r->late ? r->soft : r->soft_late;
  double lack[m + 1], size = 0.0, most = 0.0;
  if (!p->second(p->self, at->x, 1.0, at->lam)) return 0;
  for (long k = 0; k < a->n_equal; ++k) {
    lack[k] = p->g[a->equal[k]] - a->lbg[a->equal[k]];
    size += lack[k] * lack[k];
  }
  const double closed = fmin(1.0, r->closed / fmax(sqrt(size), 1e-300));
  for (long k = 0; k < a->n_equal; ++k) lack[k] *= closed;
  memcpy(q->H, p->H, n * n * sizeof(double));
  for (long j = 0; j < n; ++j) {
    const double *column = p->J + j * m;
    double sum = 0.0, square[n];
    most = fmax(most, fabs(p->H[j * n + j]));
    for (long l = 0; l < n; ++l) square[l] = 0.0;
    for (long k = 0; k < a->n_equal; ++k) {
      const long i = a->equal[k];
      sum += column[i] * (at->lam[i] + lack[k] / soft);
      for (long l = 0; l < n; ++l) square[l] += column[i] * p->J[l * m + i];
    }
    q->slope[j] = p->gradient[j] + p->more[j] + sum;
    for (long l = 0; l < n; ++l) q->H[j * n + l] += square[l] / soft;
    q->lbx[j] = fmax(a->lbx[j] - at->x[j], -r->longest);
    q->ubx[j] = fmin(a->ubx[j] - at->x[j], r->longest);
    for (long k = 0; k < a->n_uneven; ++k) q->A[j * a->n_uneven + k] = column[a->uneven[k]];
  }
  for (long k = 0; k < a->n_uneven; ++k) {
    q->lba[k] = a->lbg[a->uneven[k]] - at->g[a->uneven[k]];
    q->uba[k] = a->ubg[a->uneven[k]] - at->g[a->uneven[k]];
  }
  if (!is_finite(q->H, n * n) || !convex(q->H, at->held, n, r->shifted * most, r, at->room)) return 0;
  void *done = q->call(q->run);
  if (!done) return 0;
  q->drop(done);
  memcpy(change, q->change, n * sizeof(double));
  for (long k = 0; k < a->n_equal; ++k) {
    double moved = 0.0;
    for (long j = 0; j < n; ++j) moved += p->J[j * m + a->equal[k]] * change[j];
    after[a->equal[k]] = at->lam[a->equal[k]] + (moved + lack[k]) / soft;
  }
  for (long k = 0; k < a->n_uneven; ++k) after[a->uneven[k]] = q->own[k];
  return is_finite(change, n) && is_finite(after, m);
}

/* Go along a step as far as it helps: unknowns there, and its share; below 0 where that fails, or the states
   follow no part of it. Room: 2 n. */
static double line(const program_t *p, const asked_t *a, const rules_t *r, const point_t *at,
                   const double *change, double weight, double *trial, double *room) {
  const double before = merit(p, a, weight), most = most_of(change, p->n);
  double share = 1.0, *there = room, *way = room + p->n;
  int any = 0;
  memcpy(trial, at->x, p->n * sizeof(double));
  for (long k = 0; k < r->halved; ++k) {
    for (long j = 0; j < p->n; ++j) {
      const double inside = fmin(fmax(at->x[j] + share * change[j], a->lbx[j]), a->ubx[j]);
      way[j] = inside - at->x[j];
      there[j] = at->x[j] + way[j];
    }
    const int followed = p->value(p->self, there, way);
    if (followed < 0) return -1.0;
    if (followed) {
      any = 1;
      memcpy(trial, there, p->n * sizeof(double));
      const double now = merit(p, a, weight);
      if (isfinite(now) && (now < before || share * most < r->local)) break;
    }
    share /= 2;
  }
  return any ? share : -1.0;
}

/* Steps from at->x and at->lam; 0 where not even the first point is one. Room: 2 n n + 2 n + m. */
int run(const program_t *p, quadratic_t *q, const asked_t *a, const rules_t *r, point_t *at) {
  double *change = at->room + 2 * p->n * p->n, *trial = change + p->n, *after = trial + p->n;
  at->steps = 0, at->met = 0, at->joined = -1;
  if (!p->first(p->self, at->x) || !isfinite(*p->f)) return 0;
  for (;;) {
    look(p, a, r, at);
    at->joined = joined(p, a, r, at);
    if (at->joined >= 0 || at->met || at->steps == r->most || creeps(r, at)) return 1;
    if (!step(p, q, a, r, at, change, after)) return 1;
    const double weight = 2 * most_of(after, p->m) + 1e-3;
    const double share = line(p, a, r, at, change, weight, trial, at->room);
    if (share < 0 || !p->first(p->self, trial) || !isfinite(*p->f)) return 1;
    double most = 0.0;
    for (long i = 0; i < p->m; ++i) {
      after[i] = at->lam[i] + share * (after[i] - at->lam[i]);
      most = fmax(most, fabs(after[i]));
    }
    if (most > r->lost) return 1;
    memcpy(at->x, trial, p->n * sizeof(double));
    memcpy(at->lam, after, p->m * sizeof(double));
    ++at->steps;
  }
}
