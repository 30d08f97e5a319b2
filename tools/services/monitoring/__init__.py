"""What an observer tells those who look after services: systemd, Prometheus, log collectors."""
