
/* Evaluate the second derivatives of weight . (position of the tip) by the tensions [1 m / N^2 for
   weights without a unit]; the matrix is symmetric. Returns the status of @NAME@_tip. */
int @NAME@_hessian(const @NAME@_real tension[@NAME_UPPER@_TENDONS], const @NAME@_real weight[3],
    @NAME@_real hessian[@NAME_UPPER@_TENDONS][@NAME_UPPER@_TENDONS]);
