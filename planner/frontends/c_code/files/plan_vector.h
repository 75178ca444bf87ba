/* A sequence of targets, and the tensions that Python computes for them; plan_main.c compares. */

#include "@NAME@_plan.h"

#define TEST_TARGETS @TEST_TARGETS@

/* Tolerances of tips over the length, and of tensions over their maximum: the meshes of the two
   programs differ. */
static const @NAME@_real test_met = @TEST_MET@;
static const @NAME@_real test_alike = @TEST_ALIKE@;
static const @NAME@_real test_length = @TEST_LENGTH@;

static const @NAME@_real test_target[TEST_TARGETS * 3] = {
    @TEST_TARGET@};
static const @NAME@_real test_tension[TEST_TARGETS * @NAME_UPPER@_TENDONS] = {
    @TEST_FOUND@};
