/* Poses of many arms, LANES at a time; what is in capitals is written in by model/machine/tips.py. */
/* LANES */

/* PROGRAMS */

/* Pull at `m` sections from coefficients (TERMS, N_PULL) and the basis there (TERMS, m). */
static void pull_at(const lanes *carried, const double *basis, int m, lanes *pull) {
  for (int k = 0; k < m; ++k)
    for (int j = 0; j < N_PULL; ++j)
      pull[k * N_PULL + j] = carried[j] * basis[k] + carried[N_PULL + j] * basis[m + k] +
                             carried[2 * N_PULL + j] * basis[2 * m + k];
}

/* own[section]: (TERMS N_PULL, tendons of the section), row by row, one section after the other. */
static void carry(const double *T, long n, const lanes *before, const double *own, int tendons,
                  lanes *after) {
  for (int r = 0; r < TERMS * N_PULL; ++r) {
    lanes sum = all(0.0);
    for (int j = 0; j < tendons; ++j) {
      lanes pulls;
      for (int i = 0; i < LANES; ++i) pulls[i] = T[j * n + i];
      sum = sum + pulls * own[r * tendons + j];
    }
    after[r] = before[r] + sum;
  }
}

/* Least so far, NaN from where a number is NaN. */
static inline lanes lowest(lanes low, lanes a) {
  return each_fmin(low, a) + (a - a) + where(truth(low != low), low);
}

/* T (tendons, n), n a multiple of LANES; poses (n_seen, 7, n) at nodes in their order, least (n,)
   1 + q. The tables are those of model/machine/batch.py; room is for the coefficients. */
void poses_at(long n, int sections, int steps, int ends, int n_seen, const double *T,
              const int *tendons, const double *own, const double *base, const int *active,
              const double *basis, const double *data, const double *h, const int *end_active,
              const double *end_basis, const double *end_data, const int *seen, lanes *room,
              double *poses, double *least) {
  const int size = TERMS * N_PULL;
  for (long block = 0; block < n; block += LANES) {
    const double *pulls = T + block, *share = own;
    for (int r = 0; r < size; ++r) room[r] = all(0.0);
    for (int i = 0; i < sections; ++i) {
      carry(pulls, n, room + i * size, share, tendons[i], room + (i + 1) * size);
      pulls += tendons[i] * n;
      share += size * tendons[i];
    }
    lanes g[7], relative[7], next[7], pull[NODES * N_PULL], stretched[NODES];
    lanes low = all(INFINITY);
    int next_seen = 0;
    for (int r = 0; r < 7; ++r) g[r] = all(base[r]);
    for (int k = 0; k <= steps; ++k) {
      for (; next_seen < n_seen && seen[next_seen] == k; ++next_seen)
        for (int r = 0; r < 7; ++r)
          for (int i = 0; i < LANES; ++i) poses[(next_seen * 7 + r) * n + block + i] = g[r][i];
      if (k == steps) break;
      pull_at(room + active[k] * size, basis + k * TERMS * NODES, NODES, pull);
      step(pull, data + k * N_DATA * NODES, h + k, relative, stretched);
      chain(g, relative, next);
      for (int r = 0; r < 7; ++r) g[r] = next[r];
      for (int i = 0; i < NODES; ++i) low = lowest(low, stretched[i]);
    }
    for (int k = 0; k < ends; ++k) {
      pull_at(room + end_active[k] * size, end_basis + k * TERMS, 1, pull);
      stretch(pull, end_data + k * N_DATA, stretched);
      low = lowest(low, stretched[0]);
    }
    for (int i = 0; i < LANES; ++i) least[block + i] = low[i];
  }
}
