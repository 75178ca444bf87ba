"""Laws of a cross-section: strains to the wrench that body and tendons balance."""
