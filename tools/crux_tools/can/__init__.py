"""CAN interfaces of this machine, and the nodes on their buses: their parameters and their firmware."""

CANFD_MTU = 72  # of an interface that carries CAN FD: the bytes of struct canfd_frame
