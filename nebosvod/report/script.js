"use strict";
// Comfort only: the page reads completely without this.
document.documentElement.classList.add("js");
