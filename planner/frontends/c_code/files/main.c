/* Compare the functions of @NAME@.h with results of Python. Exit code: 0 if they agree, else 1. */

#include <stdio.h>

#include "test_vector.h"

static @NAME@_real position[@NAME_UPPER@_NODES][3], frame[@NAME_UPPER@_NODES][9];
static @NAME@_real jacobian[6][@NAME_UPPER@_TENDONS];

static @NAME@_real size(@NAME@_real x) { return x < 0 ? -x : x; }

/* Return whether n values agree with reference values to the tolerance times a scale; NaN does not. */
static int agree(const char *name, const @NAME@_real *found, const @NAME@_real *wanted, int n,
    @NAME@_real scale)
{
  @NAME@_real worst = 0;
  int i, good = 1;
  for (i = 0; i < n; ++i) {
    @NAME@_real off = size(found[i] - wanted[i]) / scale;
    if (!(off <= test_tolerance)) good = 0;
    if (!(off <= worst)) worst = off;
  }
  printf("%-24s deviation %.1e, tolerance %.1e: %s\n", name, (double)worst, (double)test_tolerance,
      good ? "agrees" : "DISAGREES");
  return good;
}

static @NAME@_real largest(const @NAME@_real *values, int n)
{
  @NAME@_real most = 0;
  int i;
  for (i = 0; i < n; ++i)
    if (size(values[i]) > most) most = size(values[i]);
  return most;
}

int main(void)
{
  const int entries = 3 * @NAME_UPPER@_TENDONS, tip = @NAME_UPPER@_NODES - 1;
  int good = @NAME@_tip(test_tension, position[0], frame[0]) == @NAME_UPPER@_OK;
  good &= agree("position of the tip", position[0], test_position + 3 * tip, 3, test_length);
  good &= agree("frame of the tip", frame[0], test_frame + 9 * tip, 9, 1);
  good &= @NAME@_nodes(test_tension, position, frame) == @NAME_UPPER@_OK;
  good &= agree("positions at the nodes", position[0], test_position, 3 * (tip + 1), test_length);
  good &= agree("frames at the nodes", frame[0], test_frame, 9 * (tip + 1), 1);
  @NAME@_jacobian(test_tension, jacobian);
  good &= agree("displacements per newton", jacobian[0], test_shift, entries,
      largest(test_shift, entries));
  good &= agree("rotations per newton", jacobian[3], test_turn, entries, largest(test_turn, entries));
  return good ? 0 : 1;
}
