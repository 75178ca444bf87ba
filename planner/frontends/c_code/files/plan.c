/* See @NAME@_plan.h. Sequential quadratic programming with exact second derivatives; each quadratic
   program is solved by a primal active set method (Nocedal, Wright, Numerical Optimization, 2nd ed.,
   2006, chapters 16.5 and 18). Tensions x are in units of SCALE newtons, the displacement c of the
   tip from the target in units of the length:

       minimise  x . x / 2 + lam . c,  where  c - SOFT (lam - lam before) = 0 .

   The soft term makes the equations regular if the tip cannot move in all directions; it vanishes as
   the multipliers converge. For a target out of reach, minimise the least squares
   c . c / 2 + SOFT x . x / 2 . */

#include "@NAME@_plan.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#define N @NAME_UPPER@_TENDONS
#define SCALE ((real)@SCALE@)      /* [N] */
#define LENGTH ((real)@ARM_LENGTH@) /* [m] */
#define MET ((real)@MET@)          /* largest c of a target that is met */
#define LEVEL ((real)@LEVEL@)      /* largest slope of a minimal effort */
#define SOFT ((real)@SOFT@)
#define ROUNDING ((real)@ROUNDING@)
#define MOST_STEPS 40
#define PATIENCE 8               /* steps without progress before least squares are minimised */
#define STUCK 3                  /* steps without progress in least squares before the method stops */
#define NEARLY (100 * SOFT)      /* largest c that the soft term may cause */
#define FAR ((real)0.1)          /* largest part of c, in lengths, that one step corrects */
#define LOCAL ((real)0.1)        /* largest step, in units, that is taken without a line search */
#define MOST_MULTIPLIER ((real)1e4)

typedef @NAME@_real real;

const real @NAME@_tension_min[N] = {
    @TENSION_MIN@};
const real @NAME@_tension_max[N] = {
    @TENSION_MAX@};
const real @NAME@_first_target[3] = {
    @FIRST_TARGET@};
const real @NAME@_first_tension[N] = {
    @FIRST_TENSION@};

/* Tensions that bend the arm by about 1 rad [N]; no step is longer. */
static const real unit[N] = {
    @UNIT@};

/* The current iterate. */
static real x[N], tip[3], gap[3], multiplier[3];
static real jacobian[6][N], hessian[N][N]; /* of c and of the Lagrangian */

/* The quadratic program: step, bounds, and active bounds (-1 lower, 1 upper). */
static real step[N], low[N], high[N], trial[N];
static int held[N];

/* Equations of the free tensions, factorised, and right hand sides, in columns. */
static real matrix[N][N], columns[4][N];

static real dot(const real *a, const real *b, int n)
{
  real sum = 0;
  int i;
  for (i = 0; i < n; ++i) sum += a[i] * b[i];
  return sum;
}

static real size(const real *a) { return @SQRT@(dot(a, a, 3)); }
static real smaller(real a, real b) { return a < b ? a : b; }
static real larger(real a, real b) { return a > b ? a : b; }
static real magnitude(real a) { return a < 0 ? -a : a; }
static real within(real a, real least, real most) { return larger(least, smaller(a, most)); }

/* Factorise the first n rows of the matrix, A = L L^T; return 0 if not positive definite. */
static int factorised(int n)
{
  int i, j;
  for (j = 0; j < n; ++j) {
    const real whole = matrix[j][j], pivot = whole - dot(matrix[j], matrix[j], j);
    if (!(pivot > ROUNDING * whole) || !(pivot > 0)) return 0;
    matrix[j][j] = @SQRT@(pivot);
    for (i = j + 1; i < n; ++i)
      matrix[i][j] = (matrix[i][j] - dot(matrix[i], matrix[j], j)) / matrix[j][j];
  }
  return 1;
}

/* Replace a right hand side by the solution. */
static void solve(real *right, int n)
{
  int i, j;
  for (i = 0; i < n; ++i) right[i] = (right[i] - dot(matrix[i], right, i)) / matrix[i][i];
  for (i = n - 1; i >= 0; --i) {
    for (j = i + 1; j < n; ++j) right[i] -= matrix[j][i] * right[j];
    right[i] /= matrix[i][i];
  }
}

/* Solve a symmetric positive definite system of three equations. */
static void solve_three(real A[3][3], real right[3])
{
  int i, j, k;
  for (j = 0; j < 3; ++j)
    for (i = j + 1; i < 3; ++i) {
      const real factor = A[i][j] / A[j][j];
      for (k = j; k < 3; ++k) A[i][k] -= factor * A[j][k];
      right[i] -= factor * right[j];
    }
  for (i = 2; i >= 0; --i) {
    for (k = i + 1; k < 3; ++k) right[i] -= A[i][k] * right[k];
    right[i] /= A[i][i];
  }
}

/* List the free tensions; return their number. */
static int those_free(int *at)
{
  int j, n = 0;
  for (j = 0; j < N; ++j)
    if (!held[j]) at[n++] = j;
  return n;
}

/* Factorise the Hessian of the free tensions plus a multiple of J^T J that makes it convex; if no
   multiple does, add to the diagonal. Return the multiple. */
static real convex(const int *at, int n, real least)
{
  real most = 0, more, shift = 0;
  int i, j, k, tries;
  for (i = 0; i < n; ++i) most = larger(most, magnitude(hessian[at[i]][at[i]]));
  for (tries = 0, more = least;; ++tries) {
    for (i = 0; i < n; ++i)
      for (j = 0; j <= i; ++j) {
        matrix[i][j] = hessian[at[i]][at[j]] + (i == j ? shift : 0);
        for (k = 0; k < 3; ++k) matrix[i][j] += more * jacobian[k][at[i]] * jacobian[k][at[j]];
      }
    if (factorised(n)) return more;
    if (tries < 3 && least == 0) more = tries ? 10 * more : 1;
    else shift = shift > 0 ? 4 * shift : larger(most, 1) * (real)1e-3;
    if (tries > 30) return more;
  }
}

/* Minimise the model with the active bounds fixed: the point `trial`, and its multipliers. */
static void equality_step(real after[3], int nearest)
{
  static int at[N];
  const int n = those_free(at);
  const real more = convex(at, n, nearest ? (real)1 : 0);
  real A[3][3], wanted[3], moved[3];
  int i, j, k;
  for (k = 0; k < 3; ++k) {
    moved[k] = gap[k];
    for (j = 0; j < N; ++j)
      if (held[j]) moved[k] += jacobian[k][j] * step[j];
    wanted[k] = moved[k] + (nearest ? 0 : SOFT * multiplier[k]);
  }
  for (i = 0; i < n; ++i) {
    columns[3][i] = -(nearest ? SOFT : 1) * x[at[i]];
    for (j = 0; j < N; ++j)
      if (held[j]) columns[3][i] -= hessian[at[i]][j] * step[j];
    for (k = 0; k < 3; ++k) {
      columns[k][i] = jacobian[k][at[i]];
      columns[3][i] -= more * jacobian[k][at[i]] * wanted[k];
    }
  }
  solve(columns[3], n);
  memcpy(trial, step, sizeof trial);
  for (k = 0; k < 3; ++k) after[k] = 0;
  if (!nearest) {
    for (k = 0; k < 3; ++k) solve(columns[k], n);
    for (k = 0; k < 3; ++k) {
      after[k] = wanted[k];
      for (i = 0; i < n; ++i) after[k] += jacobian[k][at[i]] * columns[3][i];
      for (j = 0; j < 3; ++j) {
        A[k][j] = j == k ? SOFT : 0;
        for (i = 0; i < n; ++i)
          A[k][j] += (1 - more * SOFT) * jacobian[k][at[i]] * columns[j][i];
      }
    }
    solve_three(A, after);
  }
  for (i = 0; i < n; ++i) {
    trial[at[i]] = columns[3][i];
    for (k = 0; k < 3; ++k)
      trial[at[i]] -= (1 - more * SOFT) * columns[k][i] * (nearest ? 0 : after[k]);
  }
}

/* Solve the quadratic program: the step, and the multipliers after the step. */
static void quadratic(real after[3], int nearest)
{
  int sets, j, k;
  memset(step, 0, sizeof step);
  for (sets = 0; sets < 4 * N + 4; ++sets) {
    real share = 1, worst = 0;
    int first = -1;
    equality_step(after, nearest);
    for (j = 0; j < N; ++j) {
      const real way = trial[j] - step[j];
      const real room = way < 0 ? low[j] - step[j] : high[j] - step[j];
      if (!held[j] && (way < 0 ? way < room : way > room)) {
        const real part = room / way;
        if (part < share) {
          share = part;
          first = j;
        }
      }
    }
    for (j = 0; j < N; ++j) step[j] += share * (trial[j] - step[j]);
    if (first >= 0) {
      held[first] = trial[first] < step[first] ? -1 : 1;
      step[first] = held[first] < 0 ? low[first] : high[first];
      continue;
    }
    for (j = 0; j < N; ++j) {
      real slope = (nearest ? SOFT : 1) * x[j] + dot(hessian[j], step, N);
      if (!held[j] || low[j] == high[j]) continue;
      for (k = 0; k < 3; ++k)
        slope += jacobian[k][j]
            * (nearest ? gap[k] + dot(jacobian[k], step, N) : after[k]);
      slope *= held[j] * unit[j] / SCALE;
      if (slope > worst) {
        worst = slope;
        first = j;
      }
    }
    if (first < 0 || worst <= LEVEL * LEVEL) return;
    held[first] = 0;
  }
}

/* Evaluate the tip for tensions, and c; return the status of the map. */
static int measured(const real *at, const real *target, real *where, real *off)
{
  real tension[N];
  int j, k, status;
  for (j = 0; j < N; ++j) tension[j] = SCALE * at[j];
  status = @NAME@_tip(tension, where, NULL);
  for (k = 0; k < 3; ++k) off[k] = (where[k] - target[k]) / LENGTH;
  return status;
}

/* Evaluate the Jacobian of c; return the slope of the Lagrangian in the free tensions. */
static real first_order(int first, int nearest)
{
  real tension[N], A[3][3], right[3], worst = 0, most = 0;
  int j, k, i;
  for (j = 0; j < N; ++j) tension[j] = SCALE * x[j];
  @NAME@_jacobian(tension, jacobian);
  for (k = 0; k < 3; ++k)
    for (j = 0; j < N; ++j) jacobian[k][j] *= SCALE / LENGTH;
  if (first) { /* least-squares multipliers of the tensions within the limits */
    for (k = 0; k < 3; ++k) {
      right[k] = 0;
      for (i = 0; i < 3; ++i) A[k][i] = k == i ? SOFT : 0;
    }
    for (j = 0; j < N; ++j)
      if (tension[j] > @NAME@_tension_min[j] && tension[j] < @NAME@_tension_max[j])
        for (k = 0; k < 3; ++k) {
          right[k] -= jacobian[k][j] * x[j];
          for (i = 0; i < 3; ++i) A[k][i] += jacobian[k][j] * jacobian[i][j];
        }
    solve_three(A, right);
    memcpy(multiplier, right, sizeof multiplier);
  }
  for (j = 0; j < N; ++j) {
    real slope = (nearest ? SOFT : 1) * x[j];
    for (k = 0; k < 3; ++k) slope += jacobian[k][j] * (nearest ? gap[k] : multiplier[k]);
    held[j] = 0;
    if (tension[j] <= @NAME@_tension_min[j] && slope > 0) held[j] = -1;
    if (tension[j] >= @NAME@_tension_max[j] && slope < 0) held[j] = 1;
    if (!held[j]) worst = larger(worst, magnitude(slope) * unit[j]);
    most = larger(most, x[j] * unit[j]);
  }
  return most > 0 ? worst / (most * (nearest ? SOFT : 1)) : worst;
}

/* Evaluate the Hessian of the Lagrangian, or of the least squares. */
static void seconds(int nearest)
{
  real tension[N], weight[3];
  int i, j;
  for (j = 0; j < N; ++j) tension[j] = SCALE * x[j];
  for (j = 0; j < 3; ++j)
    weight[j] = (nearest ? gap[j] : multiplier[j]) * SCALE / LENGTH * SCALE;
  @NAME@_hessian(tension, weight, hessian);
  for (i = 0; i < N; ++i) hessian[i][i] += nearest ? SOFT : 1;
  for (i = 0; i < N; ++i) {
    low[i] = larger(@NAME@_tension_min[i], SCALE * x[i] - unit[i]) / SCALE - x[i];
    high[i] = smaller(@NAME@_tension_max[i], SCALE * x[i] + unit[i]) / SCALE - x[i];
  }
}

/* Return the merit of a step: the effort plus the weighted norm of c, or the least squares. */
static real merit(const real *at, const real *off, real weight, int nearest)
{
  return nearest ? (dot(off, off, 3) + SOFT * dot(at, at, N)) / 2
                 : dot(at, at, N) / 2 + weight * size(off);
}

/* Take the longest part of the step that decreases the merit; return 0 if there is none. */
static int moved(const real target[3], const real after[3], int nearest)
{
  const real weight = 2 * size(after) + 1, before = merit(x, gap, weight, nearest);
  real share = 1, most = 0, where[3], off[3];
  int j, tries;
  for (j = 0; j < N; ++j) most = larger(most, magnitude(step[j]) * SCALE / unit[j]);
  for (tries = 0; tries < 8; ++tries, share /= 2) {
    for (j = 0; j < N; ++j) {
      const real T = SCALE * (x[j] + share * step[j]);
      trial[j] = within(T, @NAME@_tension_min[j], @NAME@_tension_max[j]) / SCALE;
    }
    if (measured(trial, target, where, off) != @NAME_UPPER@_OK) continue;
    if (share * most > LOCAL && !(merit(trial, off, weight, nearest) < before) && tries < 7) continue;
    memcpy(x, trial, sizeof x);
    memcpy(tip, where, sizeof tip);
    memcpy(gap, off, sizeof gap);
    if (!nearest)
      for (j = 0; j < 3; ++j)
        multiplier[j] = within(multiplier[j] + share * (after[j] - multiplier[j]),
            -MOST_MULTIPLIER, MOST_MULTIPLIER);
    return 1;
  }
  return 0;
}

/* Limit the part of c that one step corrects. */
static void close_part(real whole[3])
{
  const real far = size(gap) / FAR;
  int k;
  memcpy(whole, gap, 3 * sizeof *whole);
  if (far > 1)
    for (k = 0; k < 3; ++k) gap[k] /= far;
}

int @NAME@_plan(const real target[3], real tension[N], @NAME@_report *report)
{
  real after[3], whole[3], slope = 0, best;
  int j, k, nearest = 0, slow = 0, again = 0, going;
  for (j = 0; j < N; ++j)
    x[j] = within(tension[j], @NAME@_tension_min[j], @NAME@_tension_max[j]) / SCALE;
  k = measured(x, target, tip, gap);
  best = size(gap);
  if (k != @NAME_UPPER@_OK || !(best >= 0)) return @NAME_UPPER@_CRUSHED;
  for (k = 0; k < MOST_STEPS; ++k) {
    slope = first_order(k == 0, nearest);
    if (slope <= LEVEL && (size(gap) <= MET || (nearest && (again || size(gap) > NEARLY)))) break;
    if (nearest && slow >= STUCK) break;
    if (slope <= LEVEL && nearest) { /* try again to meet the target */
      nearest = slow = 0;
      again = 1;
      for (j = 0; j < 3; ++j) multiplier[j] = gap[j] / SOFT;
      slope = first_order(0, 0);
    }
    if (!nearest && slow >= PATIENCE && size(gap) > MET) {
      nearest = 1;
      slow = 0;
      best = size(gap);
      slope = first_order(0, nearest);
    }
    seconds(nearest);
    if (nearest) memcpy(whole, gap, sizeof whole);
    else close_part(whole);
    quadratic(after, nearest);
    memcpy(gap, whole, sizeof gap);
    going = moved(target, after, nearest);
    slow = size(gap) < (nearest ? (real)0.9999 : (real)0.9) * best ? 0 : slow + 1;
    best = smaller(best, size(gap));
    if (!going) break;
  }
  for (j = 0; j < N; ++j)
    tension[j] = within(SCALE * x[j], @NAME@_tension_min[j], @NAME@_tension_max[j]);
  if (report) {
    report->residual = size(gap) * LENGTH;
    report->slope = slope;
    report->iterations = k;
  }
  if (!(size(gap) <= MET)) return @NAME_UPPER@_OUT_OF_REACH;
  return slope <= LEVEL ? @NAME_UPPER@_OK : @NAME_UPPER@_NOT_OPTIMAL;
}
