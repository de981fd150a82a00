"""Time, threads, processes and memory with an owner."""

__all__ = ["clock", "mailbox", "process", "realtime", "shared_ring", "worker"]
