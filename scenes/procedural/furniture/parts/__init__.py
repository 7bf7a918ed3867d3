"""Parts that furniture is made of: bodies, the builder of pieces, simulated cloth, curtains."""
