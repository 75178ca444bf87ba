/* Map from tensions to the tensions of least effort that bring the tip to a nearby target.

   For a moving target, each call starts from the tensions of the last one. The effort is the sum of
   the squares of the tensions, each within its limits. The method follows a local optimum, as
   octoplan's plan(near=...); for large motions of the target, another optimum may have less effort.

   The code uses no heap, no files and no libraries except libm, but static work arrays: call the
   functions from one thread. */

#ifndef @NAME_UPPER@_PLAN_H
#define @NAME_UPPER@_PLAN_H

#include "@NAME@.h"

#define @NAME_UPPER@_OUT_OF_REACH 2 /* the result is the nearest position found */
#define @NAME_UPPER@_NOT_OPTIMAL 3  /* the target is met, but the effort is not minimal */

#define @NAME_UPPER@_PLAN_STATIC_BYTES (@PLAN_NUMBERS@ * sizeof(@NAME@_real)) /* in addition to the map */

/* Limits of each tension [N]. */
extern const @NAME@_real @NAME@_tension_min[@NAME_UPPER@_TENDONS];
extern const @NAME@_real @NAME@_tension_max[@NAME_UPPER@_TENDONS];

/* The scene's target [m], and the tensions of its plan [N]: the initial values. */
extern const @NAME@_real @NAME@_first_target[3];
extern const @NAME@_real @NAME@_first_tension[@NAME_UPPER@_TENDONS];

/* Report of a call.

   residual    distance of the tip from the target [m]
   slope       optimality error: the largest component of the slope of the effort that limits and
               target do not balance, over the largest tension
   iterations  number of evaluations of tip, Jacobian and second derivatives */
typedef struct {
  @NAME@_real residual, slope;
  int iterations;
} @NAME@_report;

/* Solve for the tensions of a target [m].

   tension  [N], in: tensions of the last target; out: the solution, always within the limits
   report   may be NULL

   Returns @NAME_UPPER@_OK; @NAME_UPPER@_OUT_OF_REACH or @NAME_UPPER@_NOT_OPTIMAL with the best
   tensions found; or @NAME_UPPER@_CRUSHED, with unchanged tensions, if the given tensions crush the
   arm or an argument is NaN. */
int @NAME@_plan(const @NAME@_real target[3], @NAME@_real tension[@NAME_UPPER@_TENDONS],
    @NAME@_report *report);

#endif
