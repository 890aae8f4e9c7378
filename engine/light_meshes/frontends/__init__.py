"""Entry points from outside: a parent process, a `.blend` file, a report for people."""
