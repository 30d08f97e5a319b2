"""`hoap3 report`: what a log shows, as one HTML file that needs nothing but itself."""
