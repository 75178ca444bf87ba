/* Prints for each function the instructions that a call takes, and the bytes of stack.

   QEMU is told to take 1 ns for an instruction; the system timer of its board counts every 40 ns. */

#include <stdio.h>

#include "test_vector.h"

#define CALLS 20
#define TICK 40
#define PAINT 0xA5A5A5A5u
#define PAINTED 16384 /* words */

static volatile unsigned *const timer = (volatile unsigned *)0xE000E010;

static arm_real position[ARM_NODES][3], frame[ARM_NODES][9], jacobian[6][ARM_TENDONS];

static void tip(void) { arm_tip(test_tension, position[0], frame[0]); }
static void nodes(void) { arm_nodes(test_tension, position, frame); }
static void slopes(void) { arm_jacobian(test_tension, jacobian); }
static void nothing(void) { __asm__ volatile(""); }

static unsigned ticks(void (*volatile work)(void))
{
  unsigned before = timer[2];
  int i;
  for (i = 0; i < CALLS; ++i) work();
  return (before - timer[2]) & 0xFFFFFFu;
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

static void tell(const char *name, void (*work)(void))
{
  printf("%s %u %u\n", name, (ticks(work) - ticks(nothing)) * TICK / CALLS, depth(work));
}

int main(void)
{
  timer[1] = 0xFFFFFFu; /* begin again from here */
  timer[2] = 0;
  timer[0] = 5; /* run, by the processor's clock */
  tell("tip", tip);
  tell("nodes", nodes);
  tell("jacobian", slopes);
  return 0;
}
