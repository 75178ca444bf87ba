/* Prints the instructions that a re-plan takes on a circle of the target, mean and most, the bytes of
   stack, and how many of the re-plans met their target. */

#include <math.h>
#include <stdio.h>

#include "arm_plan.h"
#include "counted.h"

#define STEPS 50
#define RADIUS 0.015 /* of a circle in steps of about 2 mm [m] */

static arm_real target[3], tension[ARM_TENDONS];
static int met;

static void replan(void)
{
  if (arm_plan(target, tension, NULL) == ARM_OK) ++met;
}

int main(void)
{
  unsigned total = 0, most = 0, taken;
  int i, j;
  start_timer();
  for (j = 0; j < ARM_TENDONS; ++j) tension[j] = arm_first_tension[j];
  for (i = 1; i <= STEPS; ++i) {
    const double angle = 6.283185307179586 * i / STEPS;
    target[0] = arm_first_target[0];
    target[1] = arm_first_target[1] + (arm_real)(RADIUS * sin(angle));
    target[2] = arm_first_target[2] + (arm_real)(RADIUS * (1 - cos(angle)));
    taken = instructions(replan, 1);
    total += taken;
    if (taken > most) most = taken;
  }
  j = met;
  printf("%u %u %u %d of %d\n", total / STEPS, most, depth(replan), j, STEPS);
  return j == STEPS ? 0 : 1;
}
