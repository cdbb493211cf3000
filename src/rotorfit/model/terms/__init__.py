"""The effects of the model, one frozen record each (`registry.TERMS`), for all to iterate over."""
