/* See @NAME@.h. CasADi generated the functions up to "Tables", each for one step along the arm. Pull
   at a cross-section is a polynomial of arc length; its coefficients are linear in the tensions and
   change at anchorages. */

#include "@NAME@.h"

#include <stddef.h>
#include <string.h>

/* Some generated functions do not use all their arguments. */
#ifdef __GNUC__
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

@CODE@

/* Tables, from base to tip. */

#define STEPS (@NAME_UPPER@_NODES - 1)
#define SEGMENTS @SEGMENTS@ /* between anchorages */
#define SECTIONS @SECTIONS@
#define POINTS @POINTS@ /* in a step, for strains */
#define COEFFICIENTS @COEFFICIENTS@
#define POSE 7
#define SUMS (6 * COEFFICIENTS) /* twists of the tip per unit of each coefficient */

typedef @NAME@_real real;

const real @NAME@_s[@NAME_UPPER@_NODES] = {
    @S@};

static const real base[POSE] = {
    @BASE@};

/* Number of sections whose tendons cross a step; 0 beyond the tip. */
static const short crossing[STEPS + 1] = {
    @CROSSING@};

static const real length[STEPS] = {
    @LENGTHS@};

static const real basis[STEPS * @BASIS_SIZE@] = {
    @BASIS@};

static const real body[STEPS * @BODY_SIZE@] = {
    @BODY@};

/* At both ends of each segment. */
static const short end_crossing[2 * SEGMENTS] = {
    @END_CROSSING@};

static const real end_basis[2 * SEGMENTS * (@BASIS_SIZE@ / POINTS)] = {
    @END_BASIS@};

static const real end_body[2 * SEGMENTS * (@BODY_SIZE@ / POINTS)] = {
    @END_BODY@};

/* Work arrays. */

static real coefficients[SECTIONS + 1][COEFFICIENTS]; /* where 0, 1, .. sections cross */
static real state[2][POSE + SUMS];                    /* before and after a step */
static real sums[SECTIONS][SUMS];                     /* up to the end of each section's tendons */

/* Evaluate the coefficients. */
static void carry(const real *tension)
{
  const real *arg[@SZ_ARG@] = {NULL};
  real *res[@SZ_RES@] = {NULL};
  arg[0] = tension;
  res[0] = coefficients[0];
  carried(arg, res, NULL, NULL, 0);
}

/* Return whether 1 + q is positive at the ends of the segments. */
static int ends_stretched(void)
{
  const real *arg[@SZ_ARG@] = {NULL};
  real *res[@SZ_RES@] = {NULL};
  int k, good = 1;
  for (k = 0; k < 2 * SEGMENTS; ++k) {
    real stretch;
    arg[0] = coefficients[end_crossing[k]];
    arg[1] = end_basis + k * (@BASIS_SIZE@ / POINTS);
    arg[2] = end_body + k * (@BODY_SIZE@ / POINTS);
    res[0] = &stretch;
    end_stretch(arg, res, NULL, NULL, 0);
    if (!(stretch > @LEAST_STRETCH@)) good = 0;
  }
  return good;
}

static void give(const real *pose, real *position, real *frame)
{
  const real *arg[@SZ_ARG@] = {NULL};
  real *res[@SZ_RES@] = {NULL};
  arg[0] = pose;
  res[0] = position;
  res[1] = frame;
  placed(arg, res, NULL, NULL, 0);
}

/* Evaluate the poses at all nodes, or at the last node only. */
static int march(const real *tension, real *position, real *frame, int all)
{
  const real *arg[@SZ_ARG@] = {NULL};
  real *res[@SZ_RES@] = {NULL};
  int k, i, good;
  carry(tension);
  good = ends_stretched();
  for (i = 0; i < @NAME_UPPER@_TENDONS; ++i)
    if (!(tension[i] - tension[i] == 0)) good = 0; /* NaN or infinite */
  memcpy(state[0], base, sizeof base);
  for (k = 0; k < STEPS; ++k) {
    real stretch[POINTS];
    if (all) give(state[k % 2], position ? position + 3 * k : NULL, frame ? frame + 9 * k : NULL);
    arg[0] = state[k % 2];
    arg[1] = coefficients[crossing[k]];
    arg[2] = basis + k * @BASIS_SIZE@;
    arg[3] = body + k * @BODY_SIZE@;
    arg[4] = length + k;
    res[0] = state[(k + 1) % 2];
    res[1] = stretch;
    pose_step(arg, res, NULL, NULL, 0);
    for (i = 0; i < POINTS; ++i)
      if (!(stretch[i] > @LEAST_STRETCH@)) good = 0;
  }
  k = all ? STEPS : 0;
  give(state[STEPS % 2], position ? position + 3 * k : NULL, frame ? frame + 9 * k : NULL);
  return good ? @NAME_UPPER@_OK : @NAME_UPPER@_CRUSHED;
}

/* Functions of the header. */

int @NAME@_tip(const real tension[@NAME_UPPER@_TENDONS], real position[3], real frame[9])
{
  return march(tension, position, frame, 0);
}

int @NAME@_nodes(const real tension[@NAME_UPPER@_TENDONS], real position[@NAME_UPPER@_NODES][3],
    real frame[@NAME_UPPER@_NODES][9])
{
  return march(tension, position ? position[0] : NULL, frame ? frame[0] : NULL, 1);
}

void @NAME@_jacobian(const real tension[@NAME_UPPER@_TENDONS],
    real jacobian[6][@NAME_UPPER@_TENDONS])
{
  const real *arg[@SZ_ARG@] = {NULL};
  real *res[@SZ_RES@] = {NULL};
  int k, i;
  carry(tension);
  memset(state, 0, sizeof state);
  memcpy(state[0], base, sizeof base);
  for (k = 0; k < STEPS; ++k) {
    real *after = state[(k + 1) % 2];
    arg[0] = state[k % 2];
    arg[1] = coefficients[crossing[k]];
    arg[2] = basis + k * @BASIS_SIZE@;
    arg[3] = body + k * @BODY_SIZE@;
    arg[4] = length + k;
    res[0] = after;
    twist_step(arg, res, NULL, NULL, 0);
    for (i = crossing[k + 1]; i < crossing[k]; ++i) memcpy(sums[i], after + POSE, sizeof sums[i]);
  }
  arg[0] = state[STEPS % 2];
  arg[1] = sums[0];
  res[0] = jacobian[0];
  tip_rows(arg, res, NULL, NULL, 0);
}
@HESSIAN@