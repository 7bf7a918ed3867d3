"""Study of photographs: networks trained on each data set, tested on real photographs."""
