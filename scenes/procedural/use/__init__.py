"""Use of a home by place: where hands, feet, seats, glasses and warm air leave traces."""
