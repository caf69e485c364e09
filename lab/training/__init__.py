"""Training the network: data from our own light, and what is learnt from it."""
