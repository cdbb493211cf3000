"""Whether a result holds on other flights: wrenches predicted, rates replayed."""
