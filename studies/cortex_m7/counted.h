/* What a piece of work takes: instructions by the system timer, and bytes of stack.

   QEMU is told to take 1 ns for an instruction; the system timer of its board counts every 40 ns. */

#ifndef COUNTED_H
#define COUNTED_H

#define TICK 40
#define PAINT 0xA5A5A5A5u
#define PAINTED 16384 /* words */

typedef void (*work_t)(void);

static volatile unsigned *const timer = (volatile unsigned *)0xE000E010;

static void nothing(void) { __asm__ volatile(""); }

static void start_timer(void)
{
  timer[1] = 0xFFFFFFu; /* begin again from here */
  timer[2] = 0;
  timer[0] = 5; /* run, by the processor's clock */
}

/* Return the ticks that so many calls of some work take. */
static unsigned ticks(volatile work_t work, int calls)
{
  unsigned before = timer[2];
  int i;
  for (i = 0; i < calls; ++i) work();
  return (before - timer[2]) & 0xFFFFFFu;
}

/* Return the instructions that a call of some work takes, in the mean of so many. */
static unsigned instructions(work_t work, int calls)
{
  return (ticks(work, calls) - ticks(nothing, calls)) * TICK / (unsigned)calls;
}

/* Return how far below this function's frame the stack is written to by some work. */
static unsigned depth(volatile work_t work)
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

#endif
