"""Kernels that have SocketCAN, and a command in one of them: this machine's, user-mode Linux, or Debian's in QEMU."""
