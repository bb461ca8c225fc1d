(() => {
  "use strict";
  const all = (name) => document.querySelectorAll(name);
  // on a phone what is long begins folded
  if (matchMedia("screen and (max-width: 760px)").matches) all("details.fold").forEach((one) => (one.open = false));
  // on paper everything is open
  addEventListener("beforeprint", () => {
    document.documentElement.classList.add("printing");
    all("details").forEach((one) => (one.open = true));
  });
  addEventListener("afterprint", () => document.documentElement.classList.remove("printing"));
})();
