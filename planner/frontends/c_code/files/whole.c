/* See @NAME@.h. CasADi generated the functions up to "Functions of the header". */

#include "@NAME@.h"

#include <stddef.h>

/* Some generated functions do not use all their arguments. */
#ifdef __GNUC__
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

@CODE@

/* Functions of the header. */

const @NAME@_real @NAME@_s[@NAME_UPPER@_NODES] = {
    @S@};

static @NAME@_real work[@SZ_W@];
static @NAME@_real stretch[@STRETCHES@];

static int stretched(const @NAME@_real *tension)
{
  int i;
  for (i = 0; i < @STRETCHES@; ++i)
    if (!(stretch[i] > @LEAST_STRETCH@)) return @NAME_UPPER@_CRUSHED;
  for (i = 0; i < @NAME_UPPER@_TENDONS; ++i)
    if (!(tension[i] - tension[i] == 0)) return @NAME_UPPER@_CRUSHED; /* NaN or infinite */
  return @NAME_UPPER@_OK;
}

int @NAME@_tip(const @NAME@_real tension[@NAME_UPPER@_TENDONS], @NAME@_real position[3],
    @NAME@_real frame[9])
{
  const @NAME@_real *arg[@SZ_ARG@] = {NULL};
  @NAME@_real *res[@SZ_RES@] = {NULL};
  int iw[@SZ_IW@];
  arg[0] = tension;
  res[0] = position;
  res[1] = frame;
  res[2] = stretch;
  tip_pose(arg, res, iw, work, 0);
  return stretched(tension);
}

int @NAME@_nodes(const @NAME@_real tension[@NAME_UPPER@_TENDONS],
    @NAME@_real position[@NAME_UPPER@_NODES][3], @NAME@_real frame[@NAME_UPPER@_NODES][9])
{
  const @NAME@_real *arg[@SZ_ARG@] = {NULL};
  @NAME@_real *res[@SZ_RES@] = {NULL};
  int iw[@SZ_IW@];
  arg[0] = tension;
  res[0] = position ? position[0] : NULL;
  res[1] = frame ? frame[0] : NULL;
  res[2] = stretch;
  node_poses(arg, res, iw, work, 0);
  return stretched(tension);
}

void @NAME@_jacobian(const @NAME@_real tension[@NAME_UPPER@_TENDONS],
    @NAME@_real jacobian[6][@NAME_UPPER@_TENDONS])
{
  const @NAME@_real *arg[@SZ_ARG@] = {NULL};
  @NAME@_real *res[@SZ_RES@] = {NULL};
  int iw[@SZ_IW@];
  arg[0] = tension;
  res[0] = jacobian[0];
  tip_rows(arg, res, iw, work, 0);
}
