/* From a set of tensions to those of least effort that bring the tip to a target nearby.

   For a target that moves: each call begins at the tensions that the one before found. What is made
   least is the sum of the squares of the tensions, each within its limits. It follows the optimum
   that it begins at, as octoplan's plan(near=...) does; another one may be cheaper where the target
   was moved far.

   No heap, no files, no libraries but libm. Static work arrays: call it from one thread. */

#ifndef @NAME_UPPER@_PLAN_H
#define @NAME_UPPER@_PLAN_H

#include "@NAME@.h"

#define @NAME_UPPER@_OUT_OF_REACH 2 /* the nearest that was found */
#define @NAME_UPPER@_NOT_OPTIMAL 3  /* the target is met, by more effort than it takes */

#define @NAME_UPPER@_PLAN_STATIC_BYTES (@PLAN_NUMBERS@ * sizeof(@NAME@_real)) /* besides the map's */

/* Limits of each tension [N]. */
extern const @NAME@_real @NAME@_tension_min[@NAME_UPPER@_TENDONS];
extern const @NAME@_real @NAME@_tension_max[@NAME_UPPER@_TENDONS];

/* The scene's target [m], and the tensions that octoplan found for it [N]: where to begin. */
extern const @NAME@_real @NAME@_first_target[3];
extern const @NAME@_real @NAME@_first_tension[@NAME_UPPER@_TENDONS];

/* What a call found.

   residual    distance of the tip from the target [m]
   slope       how far the effort is from being least: the largest part of its slope that limits and
               target do not hold, over the largest tension
   iterations  how often tip, Jacobian and second derivatives were found */
typedef struct {
  @NAME@_real residual, slope;
  int iterations;
} @NAME@_report;

/* Find the tensions for a target [m].

   tension  [N], in: those of the target before; out: those found, always within the limits
   report   may be NULL

   Returns @NAME_UPPER@_OK; @NAME_UPPER@_OUT_OF_REACH or @NAME_UPPER@_NOT_OPTIMAL, with what was found;
   or @NAME_UPPER@_CRUSHED where the tensions given crush the arm or something given is not a number:
   the tensions are those given then. */
int @NAME@_plan(const @NAME@_real target[3], @NAME@_real tension[@NAME_UPPER@_TENDONS],
    @NAME@_report *report);

#endif
