"""The arm by collocation: strains at the Gauss stages of elements, poses and moments at nodes."""
