"""Train the network: training data from our own light, and the training itself."""
