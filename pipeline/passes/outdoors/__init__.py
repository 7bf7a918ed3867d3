"""Light from outdoors that surfaces send in through openings."""
