"""Who is near whom: cell list, neighbour list, candidates, large grains."""
