// Lists the versions of the site below the search box; plain links, no server needed.
document.addEventListener("DOMContentLoaded", () => {
  const sidebar = document.querySelector(".sidebar-scroll");
  if (!sidebar || !ROTORFIT_VERSIONS.length) return;
  const root = new URL(document.documentElement.dataset.content_root || "./", location.href);
  const here = decodeURIComponent(root.pathname.replace(/\/$/, "").split("/").pop());
  const list = document.createElement("p");
  list.className = "versions";
  list.append("Version ");
  for (const version of ROTORFIT_VERSIONS) {
    const item = document.createElement(version === here ? "b" : "a");
    item.textContent = version;
    if (version !== here) item.href = new URL(`../${version}/index.html`, root).href;
    list.append(item, " ");
  }
  sidebar.prepend(list);
});
