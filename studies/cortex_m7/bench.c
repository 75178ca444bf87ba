/* Prints for each function the instructions that a call takes, and the bytes of stack. */

#include <stdio.h>

#include "counted.h"
#include "test_vector.h"

#define CALLS 20

static arm_real position[ARM_NODES][3], frame[ARM_NODES][9], jacobian[6][ARM_TENDONS];

static void tip(void) { arm_tip(test_tension, position[0], frame[0]); }
static void nodes(void) { arm_nodes(test_tension, position, frame); }
static void jacobian_once(void) { arm_jacobian(test_tension, jacobian); }

static void tell(const char *name, work_t work)
{
  printf("%s %u %u\n", name, instructions(work, CALLS), depth(work));
}

int main(void)
{
  start_timer();
  tell("tip", tip);
  tell("nodes", nodes);
  tell("jacobian", jacobian_once);
  return 0;
}
