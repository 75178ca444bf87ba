/* Results of Python for one set of tensions; main.c compares. Units as in @NAME@.h. */

#include "@NAME@.h"

/* Tolerance of positions over the length, of frames, and of derivatives over their maximum. */
static const @NAME@_real test_tolerance = @TEST_TOLERANCE@;
static const @NAME@_real test_length = @TEST_LENGTH@;

static const @NAME@_real test_tension[@NAME_UPPER@_TENDONS] = {
    @TEST_TENSION@};

/* At the nodes, from base to tip. */
static const @NAME@_real test_position[@NAME_UPPER@_NODES * 3] = {
    @TEST_POSITION@};
static const @NAME@_real test_frame[@NAME_UPPER@_NODES * 9] = {
    @TEST_FRAME@};

/* Displacements and rotations of the tip. */
static const @NAME@_real test_shift[3 * @NAME_UPPER@_TENDONS] = {
    @TEST_SHIFT@};
static const @NAME@_real test_turn[3 * @NAME_UPPER@_TENDONS] = {
    @TEST_TURN@};
