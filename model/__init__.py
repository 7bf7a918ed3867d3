"""Networks, losses, training and evaluation; the training side reads only the packed dataset."""
