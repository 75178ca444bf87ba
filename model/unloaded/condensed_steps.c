/* Poses of a closed form and their derivatives by N tensions, step by step, for any arm and mesh;
   see model/unloaded/condensed_steps.py, whose kernels are given as functions, and
   model/unloaded/steps_in_c.py, which defines N and calls this. Matrices of the kernels are stored
   by columns, all others by rows: (.., N) has the tensions last. */
#include <string.h>

typedef int kernel(const double **arg, double **res, long long *iw, double *w, int mem);

enum { POSE = 7, STRAINS = 3, BENT = 4 };

/* Steps of m nodes each; rows of resultants, n_data numbers and n_law unknown strains of
   a cross-section. maps (steps m, rows, N), data (steps m, n_data), h (steps), base (POSE). */
typedef struct {
  long steps, m, rows, n_data, n_law;
  kernel *solve, *value, *first, *second, *march, *march_first, *march_second;
  const double *maps, *data, *h, *base;
} arm_t;

/* What is found, and kept between calls: resultants (steps m, rows), strains of the law (steps m,
   n_law) and those reported (steps, m STRAINS), poses (steps + 1, POSE); by the tensions the strains
   (steps, m STRAINS, N) and the poses P (steps + 1, POSE, N); A (steps, POSE, POSE) and B (steps, m
   STRAINS, POSE) of each step; lam (steps + 1, POSE); and room for what is not kept. */
typedef struct {
  double *pull, *law, *strains, *poses, *by_tensions, *jacobian, *A, *B, *lam, *room;
} found_t;

static void settle(const arm_t *a, const found_t *f, const double *T, long node) {
  const double *maps = a->maps + node * a->rows * N;
  double *pull = f->pull + node * a->rows;
  for (long r = 0; r < a->rows; ++r, maps += N) {
    double sum = 0.0;
    for (long j = 0; j < N; ++j) sum += maps[j] * T[j];
    pull[r] = sum;
  }
  const double *given[2] = {pull, a->data + node * a->n_data};
  double *law[1] = {f->law + node * a->n_law};
  a->solve(given, law, 0, 0, 0);
}

/* Adds x y to z (N), x (inner) so many numbers apart, y (inner, N). */
static void add_row(const double *x, long apart, long inner, const double *y, double *z) {
  double sum[N] = {0.0};
  for (long k = 0; k < inner; ++k)
    for (long j = 0; j < N; ++j) sum[j] += x[k * apart] * y[k * N + j];
  for (long j = 0; j < N; ++j) z[j] += sum[j];
}

/* The poses at all nodes. */
void poses_of(const arm_t *a, const found_t *f, const double *T) {
  memcpy(f->poses, a->base, POSE * sizeof(double));
  for (long k = 0; k < a->steps; ++k) {
    double *strains = f->strains + k * a->m * STRAINS;
    for (long i = 0; i < a->m; ++i) {
      settle(a, f, T, k * a->m + i);
      const double *given[1] = {f->law + (k * a->m + i) * a->n_law};
      double *found[1] = {strains + i * STRAINS};
      a->value(given, found, 0, 0, 0);
    }
    const double *given[3] = {f->poses + k * POSE, strains, a->h + k};
    double *after[1] = {f->poses + (k + 1) * POSE};
    a->march(given, after, 0, 0, 0);
  }
}

/* The strains at `count` nodes from one on, and their derivatives. */
void strains_of(const arm_t *a, const found_t *f, const double *T, long begin, long count) {
  memset(f->by_tensions + begin * STRAINS * N, 0, count * STRAINS * N * sizeof(double));
  for (long node = begin; node < begin + count; ++node) {
    settle(a, f, T, node);
    const double *given[3] = {f->law + node * a->n_law, f->pull + node * a->rows,
                              a->data + node * a->n_data};
    double *found[2] = {f->strains + node * STRAINS, f->room};
    a->first(given, found, 0, 0, 0);
    for (long r = 0; r < STRAINS; ++r)
      add_row(f->room + r, STRAINS, a->rows, a->maps + node * a->rows * N,
              f->by_tensions + (node * STRAINS + r) * N);
  }
}

/* The poses at all nodes, and their derivatives. */
void jacobian_of(const arm_t *a, const found_t *f, const double *T) {
  const long e = a->m * STRAINS;
  memcpy(f->poses, a->base, POSE * sizeof(double));
  memset(f->jacobian, 0, POSE * N * sizeof(double));
  memset(f->jacobian + POSE * N, 0, a->steps * POSE * N * sizeof(double));
  for (long k = 0; k < a->steps; ++k) {
    double *strains = f->strains + k * e, *E = f->by_tensions + k * e * N;
    strains_of(a, f, T, k * a->m, a->m);
    double *A = f->A + k * POSE * POSE, *B = f->B + k * e * POSE;
    const double *given[3] = {f->poses + k * POSE, strains, a->h + k};
    double *after[1] = {f->poses + (k + 1) * POSE}, *first[2] = {A, B};
    a->march(given, after, 0, 0, 0);
    a->march_first(given, first, 0, 0, 0);
    const double *P = f->jacobian + k * POSE * N;
    double *next = f->jacobian + (k + 1) * POSE * N;
    for (long r = 0; r < POSE; ++r) {
      add_row(A + r, POSE, POSE, P, next + r * N);
      add_row(B + r, POSE, e, E, next + r * N);
    }
  }
}

/* Adds G^T H G to Z (N, N), of the places `at` (count) of H (all, all), and G (count, N) by rows;
   room (count, N). */
static void add_square(const double *H, long all, const long *at, long count, const double **G,
                       double *room, double *Z) {
  for (long r = 0; r < count; ++r) {
    double sum[N] = {0.0};
    for (long c = 0; c < count; ++c) {
      const double own = H[at[r] + at[c] * all];
      for (long j = 0; j < N; ++j) sum[j] += own * G[c][j];
    }
    for (long j = 0; j < N; ++j) room[r * N + j] = sum[j];
  }
  for (long i = 0; i < N; ++i) {
    double sum[N] = {0.0};
    for (long r = 0; r < count; ++r)
      for (long j = 0; j < N; ++j) sum[j] += G[r][i] * room[r * N + j];
    for (long j = 0; j < N; ++j) Z[i * N + j] += sum[j];
  }
}

/* Adds the Hessian of weights (STRAINS) . strains at a node to Z (N, N); room
   (rows, rows + N). */
static void add_bent(const arm_t *a, const found_t *f, long node, const double *weights,
                     double *room, double *Z) {
  long at[a->rows];
  const double *G[a->rows];
  const double *given[4] = {f->law + node * a->n_law, f->pull + node * a->rows,
                            a->data + node * a->n_data, weights};
  double *curved[1] = {room};
  a->second(given, curved, 0, 0, 0);
  for (long r = 0; r < a->rows; ++r) at[r] = r;
  for (long r = 0; r < a->rows; ++r) G[r] = a->maps + (node * a->rows + r) * N;
  add_square(room, a->rows, at, a->rows, G, room + a->rows * a->rows, Z);
}

/* The Hessian (N, N) of weights (steps m, STRAINS) . strains, where strains_of was last. */
void bent_of(const arm_t *a, const found_t *f, const double *weights, double *hessian) {
  memset(hessian, 0, N * N * sizeof(double));
  for (long node = 0; node < a->steps * a->m; ++node)
    add_bent(a, f, node, weights + node * STRAINS, f->room, hessian);
}

/* The Hessian (N, N) of weights (steps + 1, POSE) . poses, where jacobian_of was last. */
void hessian_of(const arm_t *a, const found_t *f, const double *weights, double *hessian) {
  const long e = a->m * STRAINS, all = POSE + e;
  double *H = f->room, *more = H + all * all;
  long at[BENT + e];
  const double *G[BENT + e];
  /* A pose after a step is linear in the position before it. */
  for (long r = 0; r < BENT + e; ++r) at[r] = r < BENT ? r : POSE + r - BENT;
  memcpy(f->lam + a->steps * POSE, weights + a->steps * POSE, POSE * sizeof(double));
  for (long k = a->steps - 1; k >= 0; --k) {
    const double *A = f->A + k * POSE * POSE, *after = f->lam + (k + 1) * POSE;
    for (long c = 0; c < POSE; ++c) {
      double sum = 0.0;
      for (long r = 0; r < POSE; ++r) sum += A[r + c * POSE] * after[r];
      f->lam[k * POSE + c] = sum + weights[k * POSE + c];
    }
  }
  memset(hessian, 0, N * N * sizeof(double));
  for (long k = 0; k < a->steps; ++k) {
    const double *lam = f->lam + (k + 1) * POSE;
    const double *given[4] = {f->poses + k * POSE, f->strains + k * e, a->h + k, lam};
    double *bent[1] = {H};
    a->march_second(given, bent, 0, 0, 0);
    for (long r = 0; r < BENT; ++r) G[r] = f->jacobian + (k * POSE + r) * N;
    for (long r = 0; r < e; ++r) G[BENT + r] = f->by_tensions + (k * e + r) * N;
    add_square(H, all, at, BENT + e, G, more, hessian);
  }
  for (long k = 0; k < a->steps; ++k)
    for (long i = 0; i < a->m; ++i) {
      const double *B = f->B + k * e * POSE, *lam = f->lam + (k + 1) * POSE;
      double work[STRAINS] = {0.0};
      for (long c = 0; c < STRAINS; ++c)
        for (long r = 0; r < POSE; ++r) work[c] += B[r + (i * STRAINS + c) * POSE] * lam[r];
      add_bent(a, f, k * a->m + i, work, f->room, hessian);
    }
}
