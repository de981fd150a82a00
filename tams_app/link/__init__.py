"""The link between two computers: keys, handshake, messages, and the process that carries them.

`keys` and `handshake` authenticate both sides, `sealing` protects what is sent, `ends` decides what
becomes of each datagram (pure: time and addresses are arguments), `gateway` has the sockets.
`messages` and `age` are what the two applications send each other, and how old it is at most.
"""
