// Filled in by docs/versions.py; a site built alone has no other versions.
const ROTORFIT_VERSIONS = [];
