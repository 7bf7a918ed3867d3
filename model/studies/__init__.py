"""The paper's studies: what people, and other programs, make of the pictures."""
