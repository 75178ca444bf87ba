/* A kernel for all its repetitions, LANES of them side by side. What it takes is gathered at places in
   x and lam, its numbers stand one set after the other; what it finds is added at places, in the
   order of the repetitions. Sizes and the kernel are written in by model/machine/repeated.py. */
/* LANES */
/* PROGRAMS */

void repeated(long count, const double *x, const double *c, const double *lam, const int *unknowns,
              const int *rows, const int *places, double *found) {
  lanes y[N_Y + 1], numbers[N_C + 1], weights[N_LAM + 1], out[N_OUT + 1];
  for (long first = 0; first < count; first += LANES) {
    const long n = count - first < LANES ? count - first : LANES;
    for (long l = 0; l < LANES; ++l) {
      const long k = first + (l < n ? l : n - 1);
      for (long i = 0; i < N_Y; ++i) y[i][l] = x[unknowns[k * N_Y + i]];
      for (long i = 0; i < N_C; ++i) numbers[i][l] = c[k * N_C + i];
      for (long i = 0; i < N_LAM; ++i) weights[i][l] = lam[rows[k * N_LAM + i]];
    }
    KERNEL;
    for (long l = 0; l < n; ++l)
      for (long i = 0; i < N_OUT; ++i) found[places[(first + l) * N_OUT + i]] += out[i][l];
  }
}
