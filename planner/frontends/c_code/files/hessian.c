
/* Second derivatives. The twists of the tip per unit of each coefficient are summed along the arm,
   together with the second-order work of a wrench on them. */

#define TERMS (@BASIS_SIZE@ / POINTS)
#define LOWER (COEFFICIENTS * (COEFFICIENTS + 1) / 2)
#define PULLS (COEFFICIENTS / TERMS * POINTS)
#define PLACE(a, b) ((b) * COEFFICIENTS - (b) * ((b) - 1) / 2 + (a) - (b)) /* a >= b */

/* Coefficients per newton of each tendon of a section, and the section of each tendon. */
static const real own[@NAME_UPPER@_TENDONS * COEFFICIENTS] = {
    @OWN@};
static const short section_of[@NAME_UPPER@_TENDONS] = {
    @SECTION_OF@};

/* Sums up to a step, and up to the end of each section's tendons. */
static real second[LOWER], seconds[SECTIONS][LOWER];

/* For one step: the wrench on each twist, and the parts A, B, C of the step's Hessian, by moves of
   the step, by coefficients, and by the pull at the points where strains are evaluated. */
static real acrosses[COEFFICIENTS][6];
static real moves[36], turns[COEFFICIENTS * 6], blocks[PULLS * PULLS], mixed[COEFFICIENTS][PULLS];

static void add_cross(const real a[3], const real b[3], real sum[3])
{
  sum[0] += a[1] * b[2] - a[2] * b[1];
  sum[1] += a[2] * b[0] - a[0] * b[2];
  sum[2] += a[0] * b[1] - a[1] * b[0];
}

static real dot(const real *a, const real *b, int n)
{
  real sum = 0;
  int i;
  for (i = 0; i < n; ++i) sum += a[i] * b[i];
  return sum;
}

/* Evaluate the spatial twist of everything beyond a section's end, per newton of a tendon. */
static void twist_of(int section, int tendon, real twist[6])
{
  int i, c;
  for (i = 0; i < 6; ++i) twist[i] = 0;
  for (c = 0; c < COEFFICIENTS; ++c)
    for (i = 0; i < 6; ++i) twist[i] += sums[section][6 * c + i] * own[tendon * COEFFICIENTS + c];
}

/* Evaluate w with z . w the work of a wrench on the bracket of a twist z with another twist. */
static void across(const real twist[6], const real wrench[6], real w[6])
{
  memset(w, 0, 6 * sizeof *w);
  add_cross(twist, wrench, w);
  add_cross(twist + 3, wrench + 3, w);
  add_cross(twist, wrench + 3, w + 3);
}

/* Evaluate the work by the steps that two tendons share; a is the tendon that ends first. */
static real shared(int a, int b)
{
  const real *lower = seconds[section_of[a]];
  real sum = 0;
  int c, d;
  for (c = 0; c < COEFFICIENTS; ++c) {
    real row = 0;
    if (own[a * COEFFICIENTS + c] == 0) continue;
    for (d = 0; d < c; ++d) row += lower[PLACE(c, d)] * own[b * COEFFICIENTS + d];
    for (; d < COEFFICIENTS; ++d) row += lower[PLACE(d, c)] * own[b * COEFFICIENTS + d];
    sum += own[a * COEFFICIENTS + c] * row;
  }
  return sum;
}

/* Add the second-order work of a wrench on the brackets of a step's twists with earlier twists. */
static void add_brackets(const real *before, const real *after, const real wrench[6])
{
  int c, d, i;
  for (c = 0; c < COEFFICIENTS; ++c) {
    real twist[6];
    for (i = 0; i < 6; ++i) twist[i] = after[6 * c + i] - before[6 * c + i];
    across(twist, wrench, acrosses[c]);
  }
  for (d = 0; d < COEFFICIENTS; ++d)
    for (c = d; c < COEFFICIENTS; ++c)
      second[PLACE(c, d)] +=
          (dot(before + 6 * c, acrosses[d], 6) + dot(before + 6 * d, acrosses[c], 6)) / 2;
}

/* Add the Hessian of a step, B^T A B, and C with the basis on both sides. */
static void add_own(const real *terms)
{
  int c, d, i, p;
  for (c = 0; c < COEFFICIENTS; ++c) {
    const int at = c % (PULLS / POINTS), term = c / (PULLS / POINTS);
    for (i = 0; i < 6; ++i) acrosses[c][i] = dot(moves + 6 * i, turns + 6 * c, 6);
    for (d = 0; d < PULLS; ++d) {
      mixed[c][d] = 0;
      for (p = 0; p < POINTS; ++p)
        mixed[c][d] += terms[TERMS * p + term] * blocks[(p * (PULLS / POINTS) + at) * PULLS + d];
    }
  }
  for (d = 0; d < COEFFICIENTS; ++d) {
    const int at = d % (PULLS / POINTS), term = d / (PULLS / POINTS);
    for (c = d; c < COEFFICIENTS; ++c) {
      real sum = dot(turns + 6 * c, acrosses[d], 6);
      for (p = 0; p < POINTS; ++p)
        sum += terms[TERMS * p + term] * mixed[c][p * (PULLS / POINTS) + at];
      second[PLACE(c, d)] += sum;
    }
  }
}

/* Sum twists and second derivatives up to the end of each section. */
static void march_seconds(const real *tension, const real wrench[6])
{
  const real *arg[@SZ_ARG@] = {NULL};
  real *res[@SZ_RES@] = {NULL};
  int k, i;
  carry(tension);
  memset(state, 0, sizeof state);
  memset(second, 0, sizeof second);
  memcpy(state[0], base, sizeof base);
  for (k = 0; k < STEPS; ++k) {
    const real *before = state[k % 2];
    real *after = state[(k + 1) % 2];
    arg[0] = before;
    arg[1] = coefficients[crossing[k]];
    arg[2] = basis + k * @BASIS_SIZE@;
    arg[3] = body + k * @BODY_SIZE@;
    arg[4] = length + k;
    arg[5] = wrench;
    res[0] = moves;
    res[1] = turns;
    res[2] = blocks;
    own_step(arg, res, NULL, NULL, 0);
    add_own(arg[2]);
    res[0] = after;
    twist_step(arg, res, NULL, NULL, 0);
    add_brackets(before + POSE, after + POSE, wrench);
    for (i = crossing[k + 1]; i < crossing[k]; ++i) {
      memcpy(sums[i], after + POSE, sizeof sums[i]);
      memcpy(seconds[i], second, sizeof second);
    }
  }
}

int @NAME@_hessian(const real tension[@NAME_UPPER@_TENDONS], const real weight[3],
    real hessian[@NAME_UPPER@_TENDONS][@NAME_UPPER@_TENDONS])
{
  real tip[3], wrench[6] = {0}, last[@NAME_UPPER@_TENDONS][6], shift[@NAME_UPPER@_TENDONS][3];
  int a, b, i, good = march(tension, tip, NULL, 0);
  memcpy(wrench + 3, weight, 3 * sizeof *weight);
  add_cross(tip, weight, wrench);
  march_seconds(tension, wrench);
  for (a = 0; a < @NAME_UPPER@_TENDONS; ++a) {
    twist_of(section_of[a], a, last[a]);
    memcpy(shift[a], last[a] + 3, sizeof shift[a]);
    add_cross(last[a], tip, shift[a]);
  }
  for (a = 0; a < @NAME_UPPER@_TENDONS; ++a) {
    real turned[3] = {0};
    add_cross(weight, last[a], turned);
    for (b = 0; b <= a; ++b) { /* a ends at the anchorage of b, or before */
      real beyond[6], w[6], turned_b[3] = {0};
      twist_of(section_of[a], b, beyond);
      for (i = 0; i < 6; ++i) beyond[i] = last[b][i] - beyond[i];
      across(beyond, wrench, w);
      add_cross(weight, last[b], turned_b);
      hessian[a][b] = shared(a, b)
          + (dot(last[a], w, 6) + dot(turned, shift[b], 3) + dot(turned_b, shift[a], 3)) / 2;
      hessian[b][a] = hessian[a][b];
    }
  }
  return good;
}
