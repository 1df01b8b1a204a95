"""What tests share: finished runs, servers, streams and processes that are killed."""
