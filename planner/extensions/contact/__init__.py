"""Plans for arms in contact: small programs in the tensions over settled shapes."""
