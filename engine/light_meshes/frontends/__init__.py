"""Who asks for a picture, from outside: a parent process, a `.blend` file, a report for people."""
