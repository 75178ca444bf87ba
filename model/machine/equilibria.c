/* Equilibria of many sets of tensions on one mesh, LANES at a time, by Newton's method.

   Unknowns and equations are those of model/transcription/layout.py. A step eliminates the elements
   from tip to base: of the node beyond, dw = A dq + a is known, w its moment (and force), q its
   quaternion; with it the equations of pose and stages give the strains dv = V dq + v and dw of the
   node before. From base to tip the changes follow. What is in capitals, and the programs, are
   written in by model/equilibrium/side_by_side.py. */
/* LANES */

#define NODE (7 + WRENCH)
#define INSIDE (STAGES * STRAINS)
#define STRIDE (NODE + INSIDE)
#define ROWS (WRENCH + INSIDE + 7)
#define COLUMNS (2 * NODE + INSIDE)
/* What changes go with: dq, the residual, the load factor. */
#define SIDES 6
enum { RESIDUAL = 4, LOAD = 5 };

/* PROGRAMS */

/* An arm on a mesh, and what is asked of it. */
typedef struct {
  long elements, levers, settles;
  const double *clamp, *tip, *element, *body, *path, *lever, *scale, *weight;
  const int *first, *tendon, *lever_at; /* crossings of a stage: first[i] to first[i + 1] */
  double start_load, farthest, settled, contraction, small, nearest, least_step, first_load;
  long steps, cuts, follows, most_steps, section_steps;
  double section_settled;
} Arm;

/* Of an element, from its elimination: how the next pose changes by the sides and dv, and its strains
   and w of the node before by the sides; u only adds to itself. */
typedef struct {
  lanes pose[7][SIDES + INSIDE], strain[INSIDE][SIDES], wrench[WRENCH + 1][SIDES];
} Eliminated;

static inline lanes either(mask c, lanes a, lanes b) {
  return (lanes)(((mask)a & c) | ((mask)b & ~c));
}
/* The greater and the smaller of two; no number if `a` is none, or `b` and `a` is not beyond. */
static inline lanes most(lanes a, lanes b) { return either(a > b | a != a, a, b); }
static inline lanes least(lanes a, lanes b) { return either(a < b | a != a, a, b); }

/* What body and tendons balance at a stage, and its Jacobian column by column. */
static void section(const Arm *arm, long stage, const lanes *T, const lanes *v, lanes *found) {
  const int n = STRAINS + STRAINS * STRAINS;
  lanes one[STRAINS + STRAINS * STRAINS];
  body(v, arm->body + stage * N_BODY, found);
  for (int p = arm->first[stage]; p < arm->first[stage + 1]; ++p) {
    tendon(v, arm->path + 4 * p, one);
    for (int i = 0; i < n; ++i) found[i] += T[arm->tendon[p]] * one[i];
  }
}

/* Solve n equations K x = right, `sides` right-hand sides in rows, without pivoting; both are
   overwritten. What has no such pivots comes out as no number, or is far off. */
static inline void solve(lanes *K, lanes *right, int n, int sides) {
  for (int p = 0; p < n; ++p) {
    const lanes inverse = 1.0 / K[p * n + p];
    for (int i = p + 1; i < n; ++i) {
      const lanes share = K[i * n + p] * inverse;
      for (int j = p + 1; j < n; ++j) K[i * n + j] -= share * K[p * n + j];
      for (int j = 0; j < sides; ++j) right[i * sides + j] -= share * right[p * sides + j];
    }
  }
  for (int p = n - 1; p >= 0; --p)
    for (int j = 0; j < sides; ++j) {
      lanes sum = right[p * sides + j];
      for (int i = p + 1; i < n; ++i) sum -= K[p * n + i] * right[i * sides + j];
      right[p * sides + j] = sum / K[p * n + p];
    }
}

/* The least pivot of K + K' (n, n), rows weighted: positive if that is definite; K is kept. */
static lanes least_pivot(const lanes *K, const double *weight, int n) {
  lanes S[INSIDE * INSIDE], low = all(INFINITY);
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) S[i * n + j] = weight[i] * K[i * n + j] + weight[j] * K[j * n + i];
  for (int p = 0; p < n; ++p) {
    low = least(S[p * n + p], low);
    for (int i = p + 1; i < n; ++i) {
      const lanes share = S[i * n + p] / S[p * n + p];
      for (int j = p + 1; j < n; ++j) S[i * n + j] -= share * S[p * n + j];
    }
  }
  return low;
}

/* Strains of a stage that need no wrench, near those given; 0 in `stands` where there are none, or
   none of least energy. */
static void settle_section(const Arm *arm, long stage, const lanes *T, lanes *v, lanes *stands) {
  static const double even[STRAINS] = {[0 ... STRAINS - 1] = 1.0};
  lanes found[STRAINS + STRAINS * STRAINS], K[STRAINS * STRAINS], step[STRAINS];
  lanes moving = all(1.0), low = all(0.0);
  for (long k = 0; k <= arm->section_steps; ++k) {
    lanes still = all(0.0);
    section(arm, stage, T, v, found);
    for (int i = 0; i < STRAINS; ++i) {
      step[i] = -found[i];
      for (int j = 0; j < STRAINS; ++j) K[i * STRAINS + j] = found[STRAINS + j * STRAINS + i];
    }
    low = least_pivot(K, even, STRAINS);
    solve(K, step, STRAINS, 1);
    for (int i = 0; i < STRAINS; ++i) {
      v[i] += where(moving, step[i]);
      const mask on = each_fabs(step[i]) > arm->section_settled * (1.0 + each_fabs(v[i]));
      still = truth((on | step[i] != step[i]) | still != 0.0);
    }
    moving = where(moving, still);
    int left = 0;
    for (int l = 0; l < LANES; ++l) left += moving[l] != 0.0;
    if (!left) break;
  }
  *stands = where(truth(low > 0.0), where(truth(moving == 0.0), *stands));
}

/* Poses from the base on, and moments and forces from the tip on, of strains in x. */
static void start(const Arm *arm, lanes load, lanes *x) {
  const long N = arm->elements;
  lanes y[1 + COLUMNS], r[ROWS];
  for (int i = 0; i < 7; ++i) x[i] = all(arm->clamp[i]);
  for (long k = 0; k < N; ++k) {
    lanes *own = x + k * STRIDE;
    y[0] = load;
    for (int i = 0; i < STRIDE; ++i) y[1 + i] = own[i];
    for (int i = 0; i < NODE; ++i) y[1 + STRIDE + i] = all(0.0);
    for (int i = 7; i < NODE; ++i) y[1 + i] = all(0.0);
    element(y, arm->element + k * N_ELEMENT, r);
    for (int i = 0; i < 7; ++i) own[STRIDE + i] = -r[WRENCH + INSIDE + i];
  }
  for (long k = N; k >= 0; --k) {
    lanes *own = x + k * STRIDE, jacobian[N_TIP_NONZEROS + N_LEVER_NONZEROS + 1];
    for (int i = 7; i < NODE; ++i) own[i] = all(0.0);
    y[0] = load;
    for (int i = 0; i < NODE; ++i) y[1 + i] = own[i];
    if (k == N) {
      for (int i = 0; i < WRENCH; ++i) y[5 + i] = own[7 + i];
      tip(y, arm->tip, r, jacobian);
    } else {
      for (int i = NODE; i < COLUMNS; ++i) y[1 + i] = own[i];
      element(y, arm->element + k * N_ELEMENT, r);
    }
    for (int i = 0; i < WRENCH; ++i) own[7 + i] = -r[i];
    for (long l = 0; l < arm->levers; ++l)
      if (arm->lever_at[l] == k) {
        lever(y, arm->lever + 6 * l, r, jacobian);
        for (int i = 0; i < 3; ++i) own[7 + i] -= r[i];
      }
  }
}

/* The side of a column of tip and levers: load factor, q, then what is no side. */
static inline int side(int column) { return column ? column - 1 : LOAD; }

/* Residual and Jacobian of w at a node by levers there: into rows of dw = A dq + a. */
static void add_levers(const Arm *arm, lanes load, long k, const lanes *node, lanes A[][SIDES]) {
  for (long l = 0; l < arm->levers; ++l) {
    lanes y[5] = {load, node[0], node[1], node[2], node[3]}, r[3], jacobian[N_LEVER_NONZEROS + 1];
    if (arm->lever_at[l] != k) continue;
    lever(y, arm->lever + 6 * l, r, jacobian);
    for (int i = 0; i < 3; ++i) A[i][RESIDUAL] -= r[i];
    for (int i = 0; i < N_LEVER_NONZEROS; ++i)
      A[LEVER_ROW[i]][side(LEVER_COLUMN[i])] -= jacobian[i];
  }
}

static void at_tip(const Arm *arm, lanes load, const lanes *node, lanes A[][SIDES]) {
  lanes y[5 + WRENCH], r[WRENCH + 1], jacobian[N_TIP_NONZEROS + 1];
  y[0] = load;
  for (int i = 0; i < 4; ++i) y[1 + i] = node[i];
  for (int i = 0; i < WRENCH; ++i) y[5 + i] = node[7 + i];
  tip(y, arm->tip, r, jacobian);
  for (int i = 0; i < WRENCH; ++i) {
    for (int j = 0; j < SIDES; ++j) A[i][j] = all(0.0);
    A[i][RESIDUAL] = -r[i];
  }
  for (int i = 0; i < N_TIP_NONZEROS; ++i)
    if (TIP_COLUMN[i] < 5) A[TIP_ROW[i]][side(TIP_COLUMN[i])] -= jacobian[i];
  add_levers(arm, load, arm->elements, node, A);
}

/* Eliminate an element: `next` is A, a of the node beyond, `own` what is found. Returns the least
   pivot of its energy. */
static lanes eliminate(const Arm *arm, lanes load, long k, const lanes *T, const lanes *x,
                       lanes next[][SIDES], Eliminated *own) {
  lanes y[1 + COLUMNS], r[ROWS], jacobian[N_NONZEROS], J[ROWS][COLUMNS] = {0};
  lanes K[INSIDE * INSIDE], right[INSIDE * SIDES], D[WRENCH + 1][SIDES + INSIDE], load_jacobian[ROWS] = {0};
  double weight[INSIDE];
  y[0] = load;
  for (int i = 0; i < COLUMNS; ++i) y[1 + i] = x[k * STRIDE + i];
  element_jacobian(y, arm->element + k * N_ELEMENT, r, jacobian);
  for (int i = 0; i < N_NONZEROS; ++i)
    if (COLUMN[i]) J[ROW[i]][COLUMN[i] - 1] = jacobian[i];
    else load_jacobian[ROW[i]] = jacobian[i];
  for (int m = 0; m < STAGES; ++m) {
    lanes found[STRAINS + STRAINS * STRAINS];
    const int row = WRENCH + m * STRAINS, column = NODE + m * STRAINS;
    section(arm, k * STAGES + m, T, y + 1 + column, found);
    for (int i = 0; i < STRAINS; ++i) {
      r[row + i] += found[i];
      weight[m * STRAINS + i] = arm->weight[m];
      for (int j = 0; j < STRAINS; ++j)
        J[row + i][column + j] += found[STRAINS + j * STRAINS + i];
    }
  }
  for (int i = 0; i < 7; ++i) {
    const int row = WRENCH + INSIDE + i;
    for (int j = 0; j < 4; ++j) own->pose[i][j] = -J[row][j];
    own->pose[i][RESIDUAL] = -r[row];
    own->pose[i][LOAD] = all(0.0);
    for (int j = 0; j < INSIDE; ++j) own->pose[i][SIDES + j] = -J[row][NODE + j];
  }
  /* w beyond by the sides and dv */
  for (int i = 0; i < WRENCH; ++i)
    for (int j = 0; j < SIDES + INSIDE; ++j) {
      D[i][j] = j == RESIDUAL || j == LOAD ? next[i][j] : all(0.0);
      for (int l = 0; l < 4; ++l) D[i][j] += next[i][l] * own->pose[l][j];
    }
  for (int i = 0; i < INSIDE; ++i) {
    const lanes *row = J[WRENCH + i], *beyond = row + STRIDE + 7;
    const lanes own_side[2] = {r[WRENCH + i], load_jacobian[WRENCH + i]};
    for (int j = 0; j < SIDES + INSIDE; ++j) {
      lanes sum = j < 4 ? row[j] : j < SIDES ? own_side[j - 4] : row[NODE + j - SIDES];
      for (int l = 0; l < WRENCH; ++l) sum += beyond[l] * D[l][j];
      if (j < SIDES) right[i * SIDES + j] = -sum;
      else K[i * INSIDE + j - SIDES] = sum;
    }
  }
  const lanes low = least_pivot(K, weight, INSIDE);
  solve(K, right, INSIDE, SIDES);
  for (int i = 0; i < INSIDE; ++i)
    for (int j = 0; j < SIDES; ++j) own->strain[i][j] = right[i * SIDES + j];
  for (int i = 0; i < WRENCH; ++i)
    for (int j = 0; j < SIDES; ++j) {
      lanes sum = j < 4 ? J[i][j] : j == RESIDUAL ? r[i] : load_jacobian[i];
      for (int l = 0; l < INSIDE; ++l) sum += J[i][NODE + l] * right[l * SIDES + j];
      for (int l = 0; l < WRENCH; ++l) {
        lanes beyond = D[l][j];
        for (int v = 0; v < INSIDE; ++v) beyond += D[l][SIDES + v] * right[v * SIDES + j];
        sum += J[i][STRIDE + 7 + l] * beyond;
      }
      own->wrench[i][j] = -sum;
    }
  add_levers(arm, load, k, x + k * STRIDE, own->wrench);
  return low;
}

/* From base to tip: how the states change on one side, `d` at the first node. */
static void substitute(const Arm *arm, const Eliminated *room, int on, lanes *d) {
  for (long k = 0; k <= arm->elements; ++k, d += STRIDE) {
    const Eliminated *own = room + k;
    for (int i = 0; i < WRENCH; ++i) {
      d[7 + i] = own->wrench[i][on];
      for (int j = 0; j < 4; ++j) d[7 + i] += own->wrench[i][j] * d[j];
    }
    if (k == arm->elements) break;
    for (int i = 0; i < INSIDE; ++i) {
      d[NODE + i] = own->strain[i][on];
      for (int j = 0; j < 4; ++j) d[NODE + i] += own->strain[i][j] * d[j];
    }
    for (int i = 0; i < 7; ++i) {
      lanes sum = own->pose[i][on] + (i < 4 ? all(0.0) : d[i]);
      for (int j = 0; j < 4; ++j) sum += own->pose[i][j] * d[j];
      for (int j = 0; j < INSIDE; ++j) sum += own->pose[i][SIDES + j] * d[NODE + j];
      d[STRIDE + i] = sum;
    }
  }
}

/* A Newton step: changes of the states, how they change with the load factor, and the least pivot of
   the energy, where they begin. */
static lanes newton_step(const Arm *arm, lanes load, const lanes *T, const lanes *x, lanes *change,
                         lanes *by_load, Eliminated *room) {
  lanes low = all(INFINITY);
  at_tip(arm, load, x + arm->elements * STRIDE, room[arm->elements].wrench);
  for (long k = arm->elements - 1; k >= 0; --k)
    low = least(eliminate(arm, load, k, T, x, room[k + 1].wrench, room + k), low);
  for (int i = 0; i < 7; ++i) change[i] = arm->clamp[i] - x[i], by_load[i] = all(0.0);
  substitute(arm, room, RESIDUAL, change);
  substitute(arm, room, LOAD, by_load);
  return low;
}

/* Where a set is on its way: tried at once, followed in load, there, or lost. */
enum { AT_ONCE, FOLLOWED, THERE, LOST };

/* `reached` is the load factor of the last equilibrium, below 0 where there is none yet. */
typedef struct {
  int way, cuts, steps;
  double last, load, reached, step;
} Set;

/* States of LANES sets (x), their change by a Newton step and by the load factor, those of the last
   equilibrium with its changes by load, and the tensions. */
typedef struct {
  long size;
  lanes *x, *change, *by_load, *begun, *along, *pull;
} States;

/* How far a step turns a frame at most, and its size relative to strains and quaternions. */
static void sizes(const Arm *arm, const lanes *x, const lanes *change, lanes *turn, lanes *size) {
  *turn = *size = all(0.0);
  for (long k = 0; k <= arm->elements; ++k) {
    for (int i = 0; i < 4; ++i) *turn = most(each_fabs(change[k * STRIDE + i]), *turn);
    for (int i = 0; i < INSIDE && k < arm->elements; ++i) {
      const long at = k * STRIDE + NODE + i;
      const lanes after = each_fabs(x[at] + change[at]);
      *size = most(each_fabs(change[at]) / (arm->scale[i % STRAINS] + after), *size);
    }
  }
  *size = most(*size, *turn);
}

/* Whether no frame has turned by more than is followed in one step, of lane l. */
static int is_near(const Arm *arm, const lanes *before, const lanes *x, int l) {
  for (long k = 0; k <= arm->elements; ++k) {
    double both = 0.0;
    for (int i = 0; i < 4; ++i) both += before[k * STRIDE + i][l] * x[k * STRIDE + i][l];
    if (!(fabs(both) > arm->nearest)) return 0;
  }
  return 1;
}

/* Read tensions and strains of sets, and begin where the arm is without loads, or near. */
static void begin(const Arm *arm, long n, int tendons, const double *T, const double *strains,
                  States *at, Set *sets) {
  lanes even = all(1.0);
  for (int i = 0; i < tendons; ++i)
    for (int l = 0; l < LANES; ++l) at->pull[i][l] = T[i * n + l];
  for (long k = 0; k < arm->elements; ++k) {
    lanes *own = at->x + k * STRIDE + NODE;
    for (int i = 0; i < INSIDE; ++i)
      for (int l = 0; l < LANES; ++l) own[i][l] = strains[(k * INSIDE + i) * n + l];
    for (int m = 0; arm->settles && m < STAGES; ++m)
      settle_section(arm, k * STAGES + m, at->pull, own + m * STRAINS, &even);
  }
  start(arm, all(arm->start_load), at->x);
  for (long k = 0; k < at->size; ++k) at->begun[k] = at->x[k], at->along[k] = all(0.0);
  for (int l = 0; l < LANES; ++l)
    sets[l] = (Set){even[l] == 0.0 ? LOST : AT_ONCE, arm->cuts, 0, 0.0, 1.0, -1.0, 1.0};
}

/* Take a Newton step of lane l, shortened if it is too far. Returns 1 if Newton's method is done, -1
   if it has failed, 0 if it goes on. */
static int newton(const Arm *arm, Set *set, States *at, double turn, double size, int l) {
  const double before = set->last;
  double factor = 1.0;
  int failed = ++set->steps > arm->steps || size != size, done = 0;
  if (!(turn <= arm->farthest)) {
    failed |= turn != turn || before > 0.0 || set->way == FOLLOWED || set->cuts-- <= 0;
    factor = arm->farthest / turn;
  } else {
    failed |= before > 0.0 && !(size <= fmax(arm->contraction * before, arm->small));
    done = size < arm->settled || size * size < arm->settled * before;
    set->last = size;
  }
  if (failed) return -1;
  for (long k = 0; k < at->size; ++k) at->x[k][l] += factor * at->change[k][l];
  return done;
}

/* What lane l does next after Newton's method has come to an end, well or not. */
static void next(const Arm *arm, Set *set, States *at, int done, int l) {
  if (done && set->load == 1.0) {
    set->way = THERE;
    return;
  }
  set->last = 0.0, set->steps = 0;
  if (!arm->follows || (!done && set->way == FOLLOWED && set->reached < 0.0)) {
    set->way = LOST;
  } else if (set->way == AT_ONCE) { /* begin without loads */
    for (long k = 0; k < at->size; ++k) at->x[k][l] = at->begun[k][l];
    set->way = FOLLOWED, set->load = 0.0;
  } else {
    if (done) {
      for (long k = 0; k < at->size; ++k) {
        at->begun[k][l] = at->x[k][l];
        at->along[k][l] = at->by_load[k][l];
      }
      set->step = set->reached < 0.0 ? 1.0 : 2.0 * set->step;
      set->reached = set->load;
    } else {
      set->step = (set->load - set->reached) / 2;
    }
    if (set->step < arm->least_step * fmax(set->reached, arm->first_load)) set->way = LOST;
    set->load = fmin(1.0, set->reached + set->step);
    for (long k = 0; k < at->size; ++k)
      at->x[k][l] = at->begun[k][l] + (set->load - set->reached) * at->along[k][l];
  }
}

/* From T (tendons, n) and strains (elements stages strains, n), columns a multiple of LANES: states
   (n_states, n); found (n,), whether these are an equilibrium that is stable and connected with that
   of the arm without loads, or near the one that it began with. */
void equilibria(long n, int tendons, const Arm *arm, const double *T, const double *strains,
                void *space, double *states, double *found) {
  const long N = arm->elements, size = N * STRIDE + NODE;
  Eliminated *room = space;
  lanes *x = (lanes *)(room + N + 1);
  States at = {size, x, x + size, x + 2 * size, x + 3 * size, x + 4 * size, x + 5 * size};
  for (long block = 0; block < n; block += LANES) {
    lanes load, turn, step_size;
    Set sets[LANES];
    begin(arm, n, tendons, T + block, strains + block, &at, sets);
    for (long step = 0; step < arm->most_steps; ++step) {
      int left = 0;
      for (int l = 0; l < LANES; ++l) left += sets[l].way < THERE, load[l] = sets[l].load;
      if (!left) break;
      const lanes low = newton_step(arm, load, at.pull, x, at.change, at.by_load, room);
      sizes(arm, x, at.change, &turn, &step_size);
      for (int l = 0; l < LANES; ++l) {
        if (sets[l].way >= THERE) continue;
        int ended = newton(arm, sets + l, &at, turn[l], step_size[l], l);
        if (ended > 0 && arm->follows && !(low[l] > 0.0)) ended = -1;
        if (ended > 0 && sets[l].reached >= 0.0 && !is_near(arm, at.begun, x, l)) ended = -1;
        if (ended) next(arm, sets + l, &at, ended > 0, l);
      }
    }
    for (int l = 0; l < LANES; ++l) found[block + l] = sets[l].way == THERE;
    for (long i = 0; i < size; ++i)
      for (int l = 0; l < LANES; ++l) states[i * n + block + l] = x[i][l];
  }
}
