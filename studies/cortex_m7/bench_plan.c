/* Prints the instructions that a re-plan takes on a circle of the target, mean and most, the bytes of
   stack, and how many of the re-plans met their target.

   QEMU is told to take 1 ns for an instruction; the system timer of its board counts every 40 ns. */

#include <math.h>
#include <stdio.h>

#include "arm_plan.h"

#define STEPS 50
#define RADIUS 0.015 /* of a circle in steps of about 2 mm [m] */
#define TICK 40
#define PAINT 0xA5A5A5A5u
#define PAINTED 16384 /* words */

static volatile unsigned *const timer = (volatile unsigned *)0xE000E010;

static arm_real target[3], tension[ARM_TENDONS];
static int met;

static void replan(void)
{
  if (arm_plan(target, tension, NULL) == ARM_OK) ++met;
}

/* Return how far below this function's frame the stack is written to by some work. */
static unsigned depth(void (*volatile work)(void))
{
  unsigned *top = __builtin_frame_address(0), *low = top - PAINTED;
  volatile unsigned *p;
  __asm__ volatile("mov %0, sp" : "=r"(top));
  for (p = low; p < top; ++p) *p = PAINT;
  work();
  for (p = low; p < top && *p == PAINT; ++p) {
  }
  return (unsigned)((char *)top - (char *)p);
}

int main(void)
{
  unsigned total = 0, most = 0, deepest = 0, taken;
  int i, j;
  timer[1] = 0xFFFFFFu; /* begin again from here */
  timer[2] = 0;
  timer[0] = 5; /* run, by the processor's clock */
  for (j = 0; j < ARM_TENDONS; ++j) tension[j] = arm_first_tension[j];
  for (i = 1; i <= STEPS; ++i) {
    const double angle = 6.283185307179586 * i / STEPS;
    unsigned before;
    target[0] = arm_first_target[0];
    target[1] = arm_first_target[1] + (arm_real)(RADIUS * sin(angle));
    target[2] = arm_first_target[2] + (arm_real)(RADIUS * (1 - cos(angle)));
    before = timer[2];
    replan();
    taken = (before - timer[2]) & 0xFFFFFFu;
    total += taken;
    if (taken > most) most = taken;
  }
  deepest = depth(replan);
  printf("%u %u %u %d of %d\n", total / STEPS * TICK, most * TICK, deepest, met - 1, STEPS);
  return met - 1 == STEPS ? 0 : 1;
}
