"""What sensors add to the truth: noise, bias, quantisation and blind spots, as pure functions of arrays."""
