"""How a run is scored: one file a protocol, each from a `MatchedRun` to a `ProtocolResult`."""
