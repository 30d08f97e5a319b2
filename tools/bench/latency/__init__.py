"""`hoap3 latency`: what the link costs beside a bare TCP echo."""
