"""A page of this machine on which a mission is written while its answer is seen: file, processes, server."""
