
/* Find the second derivatives by the tensions of weight . position of the tip [1 m / N^2 for weights
   without a unit], symmetric. Returns what @NAME@_tip does. */
int @NAME@_hessian(const @NAME@_real tension[@NAME_UPPER@_TENDONS], const @NAME@_real weight[3],
    @NAME@_real hessian[@NAME_UPPER@_TENDONS][@NAME_UPPER@_TENDONS]);
