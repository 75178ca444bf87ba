"""Plans for arms that lean on things: small programs in the tensions over settled shapes."""
