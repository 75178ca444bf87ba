/* Follow targets by @NAME@_plan.h, and compare with results of Python. Exit code: 0 if they agree. */

#include <stdio.h>

#include "plan_vector.h"

static @NAME@_real size(@NAME@_real x) { return x < 0 ? -x : x; }

int main(void)
{
  @NAME@_real tension[@NAME_UPPER@_TENDONS];
  int i, j, good = 1;
  for (j = 0; j < @NAME_UPPER@_TENDONS; ++j) tension[j] = @NAME@_first_tension[j];
  for (i = 0; i < TEST_TARGETS; ++i) {
    const @NAME@_real *wanted = test_tension + i * @NAME_UPPER@_TENDONS;
    @NAME@_real off = 0, most = 0;
    @NAME@_report report;
    const int status = @NAME@_plan(test_target + 3 * i, tension, &report);
    int agrees = status == @NAME_UPPER@_OK && report.residual <= test_met * test_length;
    for (j = 0; j < @NAME_UPPER@_TENDONS; ++j) {
      const @NAME@_real apart = size(tension[j] - wanted[j]);
      if (!(apart <= off)) off = apart;
      if (wanted[j] > most) most = wanted[j];
      if (!(tension[j] >= @NAME@_tension_min[j] && tension[j] <= @NAME@_tension_max[j])) agrees = 0;
    }
    if (!(off <= test_alike * most)) agrees = 0;
    printf("target %d: status %d after %d steps, tip error %.1e m, tension error %.1e N: %s\n", i + 1,
        status, report.iterations, (double)report.residual, (double)off,
        agrees ? "agrees" : "DISAGREES");
    good &= agrees;
  }
  return good ? 0 : 1;
}
