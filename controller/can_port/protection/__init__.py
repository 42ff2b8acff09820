"""AUTOSAR end-to-end protection: counters, checksums and the receiver's state machine."""
