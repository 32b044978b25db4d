# tessera-worker and its agent: the only worker code that includes grpcpp.
