"""Loss study: both networks trained with each of four losses (Figure 7 of the paper)."""
