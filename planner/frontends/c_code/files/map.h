/* Tensions to the shape of a tendon-driven arm, and how its tip answers to them.

   Written by octoplan @OCTOPLAN@ with CasADi @CASADI@.
   arm of @LENGTH@ m, @SCENE@, by @SCHEME@
   tip error of its mesh over arm length: @ERROR@ (estimate, at the tensions of test_vector.h)

   Lengths are in m, forces in N, angles in rad. Vectors and frames are given in the axes that the
   arm's base is given in. Tendons are numbered from the tip section to the base section.

   No heap, no files, no libraries but libm. The functions share static work arrays: call them from
   one thread, and not from an interrupt while another call is under way. */

#ifndef @NAME_UPPER@_H
#define @NAME_UPPER@_H

typedef @REAL@ @NAME@_real;

#define @NAME_UPPER@_TENDONS @TENDONS@ /* tensions */
#define @NAME_UPPER@_NODES @NODES@ /* places along the midline, base and tip among them */
#define @NAME_UPPER@_STATIC_BYTES (@NUMBERS@ * sizeof(@NAME@_real)) /* of work arrays */

#define @NAME_UPPER@_OK 0
#define @NAME_UPPER@_CRUSHED 1 /* tensions that shorten a cross-section to nothing, or NaN */

/* Arc lengths of the nodes in the unloaded arm, from the base [m]. */
extern const @NAME@_real @NAME@_s[@NAME_UPPER@_NODES];

/* Find the pose of the tip.

   tension   [N], each 0 or above
   position  of the tip [m]
   frame     row by row; its columns are the unit vectors t (tangent), n and b of the tip

   A result that is not wanted may be NULL. Returns @NAME_UPPER@_OK, or @NAME_UPPER@_CRUSHED with
   results that mean nothing. */
int @NAME@_tip(const @NAME@_real tension[@NAME_UPPER@_TENDONS], @NAME@_real position[3],
    @NAME@_real frame[9]);

/* Find the poses at all nodes, from base to tip; otherwise as @NAME@_tip. */
int @NAME@_nodes(const @NAME@_real tension[@NAME_UPPER@_TENDONS],
    @NAME@_real position[@NAME_UPPER@_NODES][3], @NAME@_real frame[@NAME_UPPER@_NODES][9]);

/* Find how the tip answers to each tension.

   jacobian  rows: displacement along x, y, z [m/N], then turn about x, y, z [rad/N]

   The Jacobian means something only at tensions for which @NAME@_tip returns @NAME_UPPER@_OK. */
void @NAME@_jacobian(const @NAME@_real tension[@NAME_UPPER@_TENDONS],
    @NAME@_real jacobian[6][@NAME_UPPER@_TENDONS]);
@HESSIAN_DECLARED@
#endif
